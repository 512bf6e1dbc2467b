"""Weights that are not what they should be are refused in one line; what is exported is made once."""

import errno
import hashlib
import os
import pickle
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from schemas.keys import CameraKey
from services.detector.model import DetectedObjects, ModelError, Request
from services.detector.runtime.exporting import DIGEST
from services.detector.runtime.loading import load, load_all
from services.detector.runtime.torch_engine import TorchEngine
from services.detector.settings import SHIPPED_MODEL, DetectorSettings
from tests.services.detector.support.requests import frame_of


def settings(folder: Path, **fields: object) -> DetectorSettings:
    given = {"model": str(SHIPPED_MODEL), "runtime": "torch", "cache": folder / "cache", **fields}
    return DetectorSettings.model_validate(given)


def refusal(folder: Path, **fields: object) -> str:
    with pytest.raises(ModelError) as refused:
        load(settings(folder, **fields), folder / "ultralytics")
    assert "\n" not in str(refused.value)
    return str(refused.value)


class Malicious:
    """Runs code when it is unpickled."""

    def __init__(self, trace: Path) -> None:
        self._trace = trace

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return Path.touch, (self._trace,)


@pytest.mark.parametrize("content", [b"", b"no weights", SHIPPED_MODEL.read_bytes()[:-1000]])
def test_a_file_that_is_no_model(content: bytes, tmp_path: Path, model_folder: Path) -> None:
    (tmp_path / "bad.pt").write_bytes(content)
    assert refusal(model_folder, model=str(tmp_path / "bad.pt")).startswith(
        f"--model {tmp_path / 'bad.pt'}: not a model"
    )


@pytest.mark.parametrize("content", [b"help", b"eval"])
def test_a_file_that_only_looks_like_a_model_is_refused_in_words(
    content: bytes, tmp_path: Path, model_folder: Path
) -> None:
    (tmp_path / "bad.pt").write_bytes(content)
    reason = refusal(model_folder, model=str(tmp_path / "bad.pt"))
    assert reason.endswith("bad.pt: not a model that can be used: damaged, or not written by torch")


def test_nothing_in_a_file_is_executed(tmp_path: Path, model_folder: Path) -> None:
    trace = tmp_path / "trace"
    (tmp_path / "evil.pt").write_bytes(pickle.dumps(Malicious(trace)))
    refusal(model_folder, model=str(tmp_path / "evil.pt"))
    assert not trace.exists()


@pytest.mark.parametrize("safe", [None, type("_SafeLoad", (), {"SUPPORTED": False}), type("_SafeLoad", (), {})])
def test_nothing_is_read_where_it_would_be_executed(
    safe: type | None, tmp_path: Path, model_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load(settings(model_folder), model_folder / "ultralytics").close()
    trace = tmp_path / "trace"
    evil = tmp_path / "evil.pt"
    evil.write_bytes(pickle.dumps(Malicious(trace)))
    monkeypatch.setattr("ultralytics.nn.tasks._SafeLoad", safe)
    assert refusal(model_folder, model=str(evil)) == (
        f"--model {evil}: what is in it would be executed: torch 2.6 and Ultralytics 8.4.175 or later are needed"
    )
    assert not trace.exists()


def test_another_format_is_named(tmp_path: Path, model_folder: Path) -> None:
    (tmp_path / "model.engine").write_bytes(b"")
    reason = refusal(model_folder, model=str(tmp_path / "model.engine"))
    assert reason.endswith("neither Ultralytics weights, which end in .pt, nor an ONNX file or a folder of OpenVINO's")


def test_unknown_classes_and_devices(model_folder: Path) -> None:
    assert refusal(model_folder, classes=["unicorn"]) == (
        f"--classes with --model {SHIPPED_MODEL}: no class is called 'unicorn'; the model knows box, pallet, forklift"
    )
    assert refusal(model_folder, device="cuda:77").startswith("--device cuda:77: ")


@pytest.mark.parametrize("device", ["intel:gpu", "mps", "tpu", "vulkan:0"])
def test_a_device_that_ultralytics_knows_and_torch_has_not_is_refused(device: str, model_folder: Path) -> None:
    assert refusal(model_folder, device=device) == f"--device {device}: torch has no such device here"


def test_classes_that_the_model_for_boxes_does_not_know_are_refused_before_anything_is_exported(
    tmp_path: Path, model_folder: Path
) -> None:
    load(settings(model_folder), model_folder / "ultralytics").close()  # Ultralytics is offline by then
    from ultralytics.models import YOLO  # noqa: PLC0415

    YOLO("yolo11n.yaml").save(tmp_path / "boxes.pt")
    cache = tmp_path / "cache"
    asked = settings(
        model_folder, runtime="onnx", cache=cache, detection_model=str(tmp_path / "boxes.pt"), classes=["pallet"]
    )
    with pytest.raises(ModelError, match=r"^--classes with --detection-model .*boxes.pt: no class is called 'pallet'"):
        load_all(asked, model_folder / "ultralytics")
    assert not cache.exists()


def test_a_model_without_masks_is_refused_beside_one_that_needs_its_masks(tmp_path: Path, model_folder: Path) -> None:
    load(settings(model_folder), model_folder / "ultralytics").close()  # Ultralytics is offline by then
    from ultralytics.models import YOLO  # noqa: PLC0415

    boxes = tmp_path / "boxes.pt"
    YOLO("yolo11n.yaml").save(boxes)
    with pytest.raises(ModelError) as refused:
        load_all(settings(model_folder, model=str(boxes), detection_model=str(boxes)), model_folder / "ultralytics")
    assert str(refused.value) == f"--model {boxes}: for detection, but beside --detection-model its masks are needed"


def test_a_model_of_another_task(tmp_path: Path, model_folder: Path) -> None:
    load(settings(model_folder), model_folder / "ultralytics").close()  # Ultralytics is offline by then
    from ultralytics.models import YOLO  # noqa: PLC0415

    YOLO("yolo26n-sem.yaml").save(tmp_path / "semantic.pt")
    assert "a model for 'semantic', not for one of segment, detect, pose, obb, classify" in refusal(
        model_folder, model=str(tmp_path / "semantic.pt")
    )


def test_a_refiner_of_other_masks_is_no_part_of_a_model(tmp_path: Path, model_folder: Path) -> None:
    import torch  # noqa: PLC0415 - as above

    load(settings(model_folder), model_folder / "ultralytics").close()
    weights = torch.load(SHIPPED_MODEL, weights_only=False)
    torch.save({**weights, "mask_refiner": {"of_features.0.weight": torch.ones(8)}}, tmp_path / "other.pt")
    reason = refusal(model_folder, model=str(tmp_path / "other.pt"))
    wrong = "its mask_refiner is none for 3 classes and 32 prototypes of masks"
    assert reason.endswith(f"other.pt: not a model that can be used: {wrong}")


def altered(folder: Path, **changes: object) -> str:
    """Return the shipped checkpoint with other entries, after Ultralytics was loaded."""
    import torch  # noqa: PLC0415 - as above

    torch.save({**torch.load(SHIPPED_MODEL, weights_only=False), **changes}, folder / "altered.pt")
    return str(folder / "altered.pt")


def module() -> Any:
    import torch  # noqa: PLC0415 - as above

    return torch.load(SHIPPED_MODEL, weights_only=False)["model"]


@pytest.mark.parametrize("runtime", ["torch", "auto"])
def test_weights_whose_output_says_nothing_are_no_model(runtime: str, tmp_path: Path, model_folder: Path) -> None:
    load(settings(model_folder), model_folder / "ultralytics").close()
    import torch  # noqa: PLC0415 - as above

    few, void = module(), module()
    few.names = {0: "box"}
    with torch.no_grad():
        for weights in void.parameters():
            weights.fill_(float("nan"))
    for wrong, why in (
        (few, "1 names for 3 classes: give its model one name for each class, numbered from 0, and save it again"),
        (void, "a score that is not a number"),
    ):
        reason = refusal(
            tmp_path, runtime=runtime, refine=False, model=altered(tmp_path, model=wrong, ema=None, mask_refiner=None)
        )
        assert re.fullmatch(rf"--model .*altered\.pt: not a model that can be used: {why}", reason)
    assert not (tmp_path / "cache").exists()


@pytest.mark.parametrize("side", [-5, 0, 31, 4097, 10**9])
def test_an_input_that_can_be_none_is_refused_unless_another_is_asked_for(
    side: int, tmp_path: Path, model_folder: Path
) -> None:
    load(settings(model_folder), model_folder / "ultralytics").close()
    model = altered(tmp_path, train_args={"imgsz": side})
    said = f"--model {model}: trained at {side} pixels, not at 32 to 4096: --image-size?"
    assert refusal(model_folder, model=model) == said
    load(settings(model_folder, model=model, image_size=96), model_folder / "ultralytics").close()


async def test_a_detection_model_finds_boxes_and_says_what_will_be_silent(tmp_path: Path, model_folder: Path) -> None:
    load(settings(model_folder), model_folder / "ultralytics").close()
    from ultralytics.models import YOLO  # noqa: PLC0415

    YOLO("yolo11n.yaml").save(tmp_path / "boxes.pt")
    model = load(settings(model_folder, model=str(tmp_path / "boxes.pt")), model_folder / "ultralytics")
    assert not model.segments
    assert "boxes.pt has no masks" in model.remarks[0]
    image = frame_of(np.zeros((48, 64, 3), np.uint8))
    (outcome,) = await model.infer([Request(CameraKey("r1", "front"), image, masks=True)])
    model.close()
    assert isinstance(outcome, DetectedObjects)
    assert all(each.mask is None for each in outcome.objects)


def test_the_input_is_as_large_as_in_training_unless_told_otherwise(model_folder: Path) -> None:
    own = load(settings(model_folder), model_folder / "ultralytics")
    other = load(settings(model_folder, image_size=96), model_folder / "ultralytics")
    assert own.facts.longest in {320, 640}
    assert other.facts.longest == 96
    own.close()
    other.close()


def test_an_export_is_made_once_and_openvino_and_onnx_share_it(model_folder: Path) -> None:
    for runtime in ("onnx", "openvino", "onnx"):
        load(settings(model_folder, runtime=runtime), model_folder / "ultralytics").close()
    cached = [each.name for each in (model_folder / "cache").iterdir() if each.is_dir()]
    assert len([name for name in cached if name.endswith("-onnx")]) == 1
    assert not [name for name in cached if name.startswith(".")]


@pytest.mark.parametrize(("runtime", "before"), [("onnx", False), ("onnx", True), ("openvino", True)])
def test_a_damaged_export_is_made_again(
    runtime: str, *, before: bool, tmp_path: Path, model_folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    load(settings(model_folder, runtime="onnx"), model_folder / "ultralytics").close()
    cache = tmp_path / "cache"
    shutil.copytree(model_folder / "cache", cache)
    (file,) = (file for file in cache.rglob("*.onnx") if file.stat().st_size > 1_000_000)
    whole = file.stat().st_size
    file.write_bytes(b"damaged")
    if before:  # it was kept as it is
        (file.parent / DIGEST).write_text(f"{hashlib.sha256(b'damaged').hexdigest()} {file.parent.name}\n")
    load(settings(tmp_path, runtime=runtime), tmp_path / "ultralytics").close()
    said = f"{file} cannot be loaded, and is" if before else f"{file}: its SHA-256 is not the recorded one;"
    assert said in caplog.text
    assert abs(file.stat().st_size - whole) < 1_000
    assert not [each for each in cache.iterdir() if each.name.startswith(".")]


def test_a_model_whose_name_is_no_text_has_one_that_can_be_sent(tmp_path: Path, model_folder: Path) -> None:
    odd = tmp_path / os.fsdecode(b"\xff.pt")
    shutil.copy(SHIPPED_MODEL, odd)
    model = load(settings(model_folder, model=str(odd)), model_folder / "ultralytics")
    model.close()
    assert model.name == r"\udcff.pt"


def test_what_a_cache_cannot_hold_is_made_elsewhere_and_it_is_said(
    tmp_path: Path, model_folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").touch()
    cache = tmp_path / "file" / "cache"
    load(settings(model_folder, runtime="onnx", cache=cache), tmp_path / "ultralytics").close()
    assert f"--cache {cache}: Not a directory: what is exported is not kept" in caplog.text
    assert len(list((tmp_path / "ultralytics").rglob("*.onnx"))) == 1


def test_a_cache_that_gets_full_is_none(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = shutil.copy

    def filling(source: Path, to: Path) -> Path:
        copy(source, to)
        if to.is_relative_to(tmp_path / "cache"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(to))
        return to

    monkeypatch.setattr(shutil, "copy", filling)
    load(settings(tmp_path, runtime="onnx"), tmp_path / "ultralytics").close()
    assert f"--cache {tmp_path / 'cache'}: No space left on device: what is exported is not kept" in caplog.text
    assert not list((tmp_path / "cache").iterdir())


def test_who_may_read_the_cache_may_read_what_is_exported(model_folder: Path) -> None:
    load(settings(model_folder, runtime="onnx"), model_folder / "ultralytics").close()
    cache = model_folder / "cache"
    assert {each.stat().st_mode for each in cache.iterdir() if each.is_dir()} == {cache.stat().st_mode}


def test_a_torch_that_does_not_run_leaves_the_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, model_folder: Path
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("no kernel image is available")

    monkeypatch.setattr(TorchEngine, "run", fail)
    assert load(settings(tmp_path, runtime="auto", refine=False), model_folder).facts.runtime != "torch"
