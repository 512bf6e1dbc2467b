"""Of every head that Ultralytics ships the detector finds what a bare call of Ultralytics finds, box by box.

Masks that surer ones mostly cover are left out by the detector alone, so here none is.
"""

from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from numpy.typing import NDArray

from services.detector.model import DetectedObjects, ModelError
from services.detector.runtime import postprocess
from services.detector.runtime.loading import load
from services.detector.settings import DetectorSettings
from tests.services.detector.runtime.bare_calls import (
    SIDE,
    Rows,
    bare,
    built_file,
    check_same,
    nearest,
    picture,
    vars_of,
)
from tests.services.detector.support.requests import request

pytestmark = pytest.mark.usefixtures("shut_network", "covered_masks")

HEADS: Final = {
    "yolov3-tiny.yaml": "Detect",
    "yolov5n.yaml": "Detect",
    "yolov8n-p6.yaml": "Detect",
    "yolo11n.yaml": "Detect",
    "yolo26n.yaml": "Detect",
    "yolov10n.yaml": "v10Detect",
    "yolov8n-world.yaml": "WorldDetect",
    "yolov8n-worldv2.yaml": "WorldDetect",
    "yoloe-11n.yaml": "YOLOEDetect",
    "yolov8n-rtdetr.yaml": "RTDETRDecoder",
    "yolov8n-seg.yaml": "Segment",
    "yolo26n-seg.yaml": "Segment26",
    "yoloe-11n-seg.yaml": "YOLOESegment",
    "yoloe-26n-seg.yaml": "YOLOESegment26",
}
NMS_FREE: Final = ("yolo26n.yaml", "yolov10n.yaml", "yolo26n-seg.yaml", "yoloe-26n-seg.yaml")


@pytest.fixture
def covered_masks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(postprocess, "MOSTLY", 1.0)


def file_of(architecture: str, files: dict[str, Path]) -> Path:
    return built_file(architecture, files, HEADS[architecture])


def picture_for(architecture: str) -> NDArray[np.uint8]:
    """Return a picture; for masks one of the input's size: Ultralytics interpolates others in two steps."""
    return picture(96, 128) if "-seg" in architecture else picture()


def ours(file: Path, image: NDArray[np.uint8], folder: Path, *, masks: bool = False, **options: object) -> Rows:
    chosen = {"runtime": "torch", "device": "cpu", "image_size": SIDE, "cache": folder / "of heads", **options}
    model = load(DetectorSettings.model_validate({"model": str(file), **chosen}), folder / "ultralytics")
    try:
        (outcome,) = model.run([request(image, masks=masks)])
    finally:
        model.close()
    assert isinstance(outcome, DetectedObjects)
    rows = [(*vars_of(each.box), each.score, each.label) for each in outcome.objects]
    return np.array(rows, np.float64).reshape(-1, 6)


def test_every_head_that_ultralytics_ships_is_compared(files: dict[str, Path]) -> None:
    del files
    from tests.services.detector.runtime import built_models  # noqa: PLC0415 - as above

    assert set(built_models.architectures().values()) == set(HEADS.values())


@pytest.mark.parametrize("architecture", HEADS)
def test_boxes_are_those_of_a_bare_call(architecture: str, files: dict[str, Path], model_folder: Path) -> None:
    file, image = file_of(architecture, files), picture_for(architecture)
    expected = bare(file, image)
    check_same(ours(file, image, model_folder), expected)
    if "-seg" in architecture:
        check_same(ours(file, image, model_folder, masks=True), expected)


def test_a_stretched_image_of_another_shape_has_its_boxes_where_they_are(
    files: dict[str, Path], model_folder: Path
) -> None:
    file, tall = file_of("yolov8n-rtdetr.yaml", files), picture(200, 60)
    check_same(ours(file, tall, model_folder), bare(file, tall))


@pytest.mark.parametrize("architecture", NMS_FREE)
def test_the_nms_free_head_finds_what_it_finds_in_a_bare_call(
    architecture: str, files: dict[str, Path], model_folder: Path
) -> None:
    file, image = file_of(architecture, files), picture_for(architecture)
    for agnostic in (False, True):
        expected = bare(file, image, nms=False, agnostic_nms=agnostic)
        check_same(ours(file, image, model_folder, nms=False, agnostic_nms=agnostic), expected)
        assert len(bare(file, image, agnostic_nms=agnostic)) != len(expected)


@pytest.mark.parametrize("architecture", ["yolo11n.yaml", "yolo26n-seg.yaml"])
def test_boxes_are_suppressed_whatever_their_classes_where_that_is_asked_for(
    architecture: str, files: dict[str, Path], model_folder: Path
) -> None:
    file, image = file_of(architecture, files), picture_for(architecture)
    expected = bare(file, image, agnostic_nms=True)
    check_same(ours(file, image, model_folder, agnostic_nms=True), expected)
    assert len(ours(file, image, model_folder)) > len(expected)


@pytest.mark.parametrize("architecture", ["yoloe-11n.yaml", "yoloe-26n-seg.yaml"])
def test_yoloe_suppresses_boxes_whatever_their_classes_unless_told_otherwise(
    architecture: str, files: dict[str, Path], model_folder: Path
) -> None:
    file, image = file_of(architecture, files), picture_for(architecture)
    own, others = bare(file, image), bare(file, image, agnostic_nms=False)
    assert len(own) < len(others)
    check_same(ours(file, image, model_folder), own)
    check_same(ours(file, image, model_folder, agnostic_nms=False), others)


@pytest.mark.parametrize(
    ("architecture", "options"),
    [
        ("yolo26n.yaml", {}),
        ("yolo26n.yaml", {"nms": False}),
        ("yoloe-26n-seg.yaml", {"nms": False}),
    ],
)
def test_a_choice_of_head_is_the_same_in_an_exported_file(
    architecture: str, options: dict[str, Any], files: dict[str, Path], model_folder: Path
) -> None:
    file, image = file_of(architecture, files), picture_for(architecture)
    expected = bare(file, image, **options)
    found = ours(file, image, model_folder, runtime="onnx", **options)
    for some, others in ((found, expected), (expected, found)):
        sure = some[some[:, 4] > 0.4]  # a head may choose others of those that are equally unlikely
        _, apart = nearest(sure, others, pixels=0.5, score=5e-3)
        assert len(sure) >= 2
        assert apart.max() < 1


@pytest.mark.parametrize(
    ("architecture", "settings"),
    [
        ("yolo11n.yaml", {"classes": ["1", "2"], "iou": 0.3}),
        ("yolo11n.yaml", {"confidence": 0.4, "max_detections": 5}),
        ("yolov8n-rtdetr.yaml", {"classes": ["1", "2"], "confidence": 0.4, "max_detections": 5}),
    ],
)
def test_settings_choose_as_ultralytics_own_do(
    architecture: str, settings: dict[str, Any], files: dict[str, Path], model_folder: Path
) -> None:
    file, image = file_of(architecture, files), picture_for(architecture)
    names = {"confidence": "conf", "max_detections": "max_det"}
    options = {names.get(name, name): value for name, value in settings.items()}
    if "classes" in options:
        options["classes"] = [int(name) for name in options["classes"]]
    check_same(ours(file, image, model_folder, **settings), bare(file, image, **options))


def test_a_head_that_a_model_has_not_is_refused(files: dict[str, Path], model_folder: Path) -> None:
    for architecture, nms, why in (
        ("yolo11n.yaml", False, "it has no NMS-free head, as YOLO26 and YOLOv10 have: leave --no-nms out"),
        (
            "yolov8n-rtdetr.yaml",
            True,
            "an RT-DETR model finds each object once, and has no other head: leave --nms out",
        ),
    ):
        file = file_of(architecture, files)
        with pytest.raises(ModelError) as refused:
            ours(file, picture(), model_folder, nms=nms)
        assert str(refused.value) == f"{'--nms' if nms else '--no-nms'} with --model {file}: {why}"


def test_a_model_that_has_only_its_nms_free_head_left_uses_it(files: dict[str, Path], model_folder: Path) -> None:
    import torch  # noqa: PLC0415 - as above

    from tests.services.detector.runtime import built_models  # noqa: PLC0415 - as above

    whole, image = file_of("yolo26n.yaml", files), picture()
    model = torch.load(whole, weights_only=False)["model"].float()
    model.end2end = True
    model.model[-1].fuse()
    file = built_models.write(model, files[""] / "one-branch.pt")
    check_same(ours(file, image, model_folder), bare(whole, image, nms=False))
    with pytest.raises(ModelError, match="it has nothing left but its NMS-free head: leave --nms out"):
        ours(file, image, model_folder, nms=True)
