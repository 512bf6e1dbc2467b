"""The command with a model of its own: one with random weights, which finds objects of any score."""

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from services.detector.runtime.offline import keep_offline
from services.detector.settings import DetectorSettings
from services.toolbox.detect.process import run
from services.toolbox.detect.settings import DetectSettings
from services.toolbox.help import Usage, help_text
from services.toolbox.settings import _Common, load


@pytest.fixture(scope="module")
def model(model_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    keep_offline(model_folder / "ultralytics", download=False)
    from tests.services.detector.runtime import built_models  # noqa: PLC0415 - it must be offline by then

    built = built_models.build("yolo26n.yaml")
    built.names = [f"{each}\udcff" for each in "abcd"]
    return built_models.write(built, tmp_path_factory.mktemp("model") / "new.pt")


@pytest.fixture
def image(tmp_path: Path) -> Path:
    coarse = np.random.default_rng(3).integers(0, 255, (9, 14, 3), np.uint8)
    path = tmp_path / "photo.png"
    assert cv2.imwrite(str(path), cv2.resize(coarse, (150, 90), interpolation=cv2.INTER_CUBIC))
    return path


@pytest.fixture
def found(image: Path, model: Path, capsys: pytest.CaptureFixture[str]) -> Any:
    """Return what runs the command with options, and returns the objects that it prints."""

    async def found(**options: object) -> list[dict[str, Any]]:
        settings = {"image": image, "local": True, "json": True, "model": str(model), "device": "cpu", **options}
        assert await run(DetectSettings.model_validate(settings)) == 0
        objects: list[dict[str, Any]] = json.loads(capsys.readouterr().out)["objects"]
        return objects

    return found


async def test_settings_of_a_detector_say_why_a_model_finds_nothing(found: Any) -> None:
    few, many = await found(confidence=0.7), await found(confidence=0.05)
    assert 0 < len(few) < len(many)
    name = few[-1]["name"]
    assert {each["name"] for each in await found(confidence=0.05, classes=[name])} == {name}
    assert len(await found(confidence=0.05, max_detections=3)) == 3
    assert len(await found(confidence=0.05, iou=0.1)) < len(many)
    assert len(await found(confidence=0.05, agnostic_nms=True)) < len(many)
    assert len(await found(confidence=0.05, nms=False, max_detections=1000)) != len(many)
    assert len(await found(confidence=0.05, image_size=64)) != len(many)


async def test_why_nothing_is_found_is_said(image: Path, model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async def said(**options: object) -> str:
        given = {"image": image, "local": True, "json": True, "model": str(model), "device": "cpu", **options}
        assert await run(DetectSettings.model_validate(given)) == 0
        printed = capsys.readouterr()
        assert json.loads(printed.out)["objects"] == []
        return printed.err

    line = await said(confidence=0.99)
    assert line.startswith("fleetsight detect: nothing found in an image of 150 x 90 pixels; the best scores are ")
    assert line.count("\n") == 1
    scores = [float(score) for score in re.findall(r" (0\.\d\d) \(--confidence 0\.99\)", line)]
    assert scores == sorted(scores, reverse=True)
    assert scores[0] > 0.5
    names = re.findall(r"([abcd]\S+) 0\.", line)
    others = [rf"{name}\udcff" for name in "abcd" if not names[0].startswith(name)]
    line = await said(confidence=0.99, classes=others, image_size=64)
    assert "scaled to 64 (--image-size)" in line
    assert "(not among --classes)" in line
    line = await said(confidence=0.1, class_confidence=[rf"{name}\udcff=0.99" for name in "abcd"])
    assert "(--class-confidence 0.99)" in line


async def test_a_second_model_finds_the_boxes(found: Any, model: Path) -> None:
    boxes = await found(confidence=0.3)
    paired = await found(confidence=0.3, model=None, detection_model=str(model))
    assert [(each["name"], each["box"]) for each in paired] == [(each["name"], each["box"]) for each in boxes]


@pytest.mark.parametrize("option", ["model", "detection_model"])
def test_weights_that_are_not_here_are_named(image: Path, option: str) -> None:
    with pytest.raises(ValidationError, match=f"--{option.replace('_', '-')} gone.pt: no such file"):
        DetectSettings.model_validate({"image": image, "local": True, option: "gone.pt"})


async def test_a_classs_name_with_half_a_character_is_printed_as_its_escape(found: Any) -> None:
    names = {each["name"] for each in await found(confidence=0.05)}
    assert names
    assert all(name.endswith(r"\udcff") for name in names)


@pytest.mark.parametrize(
    ("option", "value"),
    [("confidence", 0.1), ("image_size", 64), ("classes", ["a"]), ("runtime", "onnx"), ("agnostic_nms", True)],
)
def test_what_a_worker_has_settings_of_its_own_for_is_refused_without_local(
    option: str, value: object, image: Path, tmp_path: Path
) -> None:
    DetectSettings.model_validate({"image": image, "cache": tmp_path, option: value, "local": True})
    DetectSettings.model_validate({"image": image, "cache": tmp_path, "device": "cpu", "threads": 1})
    with pytest.raises(ValueError, match=f"--{option.replace('_', '-')} is for --local: workers have their own"):
        DetectSettings.model_validate({"image": image, option: value})


def test_choices_that_a_model_has_a_default_for_are_switches() -> None:
    settings = load(DetectorSettings, ["--no-nms", "--agnostic-nms"], prog="fleetsight detector").settings
    assert (settings.nms, settings.agnostic_nms) == (False, True)
    assert (DetectorSettings().nms, DetectorSettings().agnostic_nms) == (None, None)
    text = help_text(DetectorSettings, _Common, Usage("fleetsight detector"), env_prefix="FLEETSIGHT_", width=80)
    assert "  --nms, --no-nms " in text
    assert "  --agnostic-nms, --no-agnostic-nms\n" in text


def test_such_a_choice_is_read_from_the_environment_and_from_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "settings.yaml").write_text("nms: false\n")
    monkeypatch.setenv("FLEETSIGHT_AGNOSTIC_NMS", "no")
    options = ["--config", str(tmp_path / "settings.yaml")]
    settings = load(DetectorSettings, options, prog="fleetsight detector").settings
    assert (settings.nms, settings.agnostic_nms) == (False, False)
