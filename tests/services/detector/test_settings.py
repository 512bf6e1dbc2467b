import os
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from services.detector import settings
from services.detector.settings import SHIPPED_EXPORT, SHIPPED_MODEL, DetectorSettings, default_cache


@pytest.mark.parametrize(
    ("fields", "file"),
    [
        ({}, SHIPPED_EXPORT),
        ({"device": "cpu", "runtime": "openvino"}, SHIPPED_EXPORT),
        ({"runtime": "torch"}, SHIPPED_MODEL),
        ({"device": "cuda:0"}, SHIPPED_MODEL),
        ({"device": "0"}, SHIPPED_MODEL),
        ({"model": "warehouse-n-seg.pt"}, SHIPPED_MODEL),
        ({"model": "warehouse-n-seg.onnx", "device": "cuda:0"}, SHIPPED_EXPORT),
    ],
)
def test_the_shipped_model_is_there_in_the_form_that_the_device_takes(
    fields: dict[str, Any], file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(settings, "GPU", tmp_path / "no driver")
    chosen = DetectorSettings.model_validate(fields)
    assert Path(chosen.model) == file
    assert chosen.is_shipped


def test_on_a_machine_with_a_gpu_the_shipped_model_is_its_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(settings, "GPU", tmp_path)
    assert Path(DetectorSettings().model) == SHIPPED_MODEL
    assert Path(DetectorSettings(device="cpu").model) == SHIPPED_EXPORT


def test_an_absent_file_is_an_error_unless_downloading_is_allowed() -> None:
    with pytest.raises(ValidationError, match=r"--model yolo11n-seg\.pt: no such file"):
        DetectorSettings(model="yolo11n-seg.pt")
    assert DetectorSettings(model="yolo11n-seg.pt", download=True).model == "yolo11n-seg.pt"


def test_a_folder_is_no_model(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match=f"--model {tmp_path}: a folder"):
        DetectorSettings(model=str(tmp_path))


def test_an_absent_file_whose_name_is_no_text_is_named() -> None:
    with pytest.raises(ValidationError, match=r"--model \\udcff\.pt: no such file"):
        DetectorSettings(model=os.fsdecode(b"\xff.pt"))


def test_what_is_made_of_weights_is_below_a_users_cache_and_without_a_home_nowhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert default_cache() == tmp_path / "fleetsight"
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_cache() == tmp_path / ".cache" / "fleetsight"

    def unknown() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", unknown)
    with pytest.raises(NotADirectoryError):
        default_cache().mkdir(parents=True, exist_ok=True)


def test_no_detector_is_called_as_gateways_know_a_second_opinion() -> None:
    with pytest.raises(ValidationError, match=r"--worker opinion\.x: the prefix 'opinion\.' is reserved"):
        DetectorSettings(worker="opinion.x")
    assert DetectorSettings(worker="opinion.x", opinion=True).worker == "opinion.x"
    assert DetectorSettings(worker="opinion-x").worker == "opinion-x"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("confidence", -0.1),
        ("confidence", 1.1),
        ("iou", 2),
        ("max_detections", 0),
        ("threads", -1),
        ("threads", 1025),
        ("worker", "a/b"),
    ],
)
def test_what_is_out_of_range_is_named(field: str, value: object) -> None:
    with pytest.raises(ValidationError) as caught:
        DetectorSettings.model_validate({field: value, "model": "x", "download": True})
    assert caught.value.errors()[0]["loc"] == (field,)


def test_shipped_weights_go_by_their_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert DetectorSettings(model=SHIPPED_MODEL.name).is_shipped
    (tmp_path / SHIPPED_MODEL.name).write_bytes(b"another")
    assert DetectorSettings(model=SHIPPED_MODEL.name).model == SHIPPED_MODEL.name


def test_the_fleet_s_model_is_no_file_and_no_opinion() -> None:
    assert DetectorSettings(model="fleet").follows_fleet
    assert not DetectorSettings(model="fleet").is_shipped
    with pytest.raises(ValidationError, match="--opinion tries one model beside the fleet's: name its file"):
        DetectorSettings(model="fleet", opinion=True)
    alone = "--detection-model fleet: only --model of `fleetsight detector` follows the fleet's; name a file"
    with pytest.raises(ValidationError, match=alone):
        DetectorSettings(detection_model="fleet")


@pytest.mark.parametrize(
    ("missing", "device", "runtime", "file"),
    [
        ("onnxruntime", None, None, SHIPPED_MODEL),
        ("onnxruntime", "cpu", "openvino", SHIPPED_MODEL),
        ("torch", None, None, SHIPPED_EXPORT),
        ("torch", None, "torch", SHIPPED_EXPORT),
        ("nothing", " CPU", None, SHIPPED_EXPORT),
    ],
)
def test_the_shipped_model_is_in_the_form_that_what_is_installed_can_read(
    *,
    missing: str,
    device: str | None,
    runtime: str | None,
    file: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(settings, "GPU", tmp_path / "no driver")
    monkeypatch.setattr(settings, "find_spec", lambda name: None if name == missing else name)
    assert settings.shipped_file(device, runtime) == file


def test_openvino_computes_on_the_processor_also_beside_a_gpu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(settings, "GPU", tmp_path)
    assert settings.shipped_file(None, "auto") == SHIPPED_MODEL
    assert settings.shipped_file(None, "openvino-int8") == SHIPPED_EXPORT


def test_the_default_model_does_not_depend_on_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(settings.SHIPPED).mkdir()
    assert DetectorSettings(device="cpu").is_shipped
    with pytest.raises(ValidationError, match="--model warehouse-n-seg: a folder"):
        DetectorSettings(model=settings.SHIPPED)
