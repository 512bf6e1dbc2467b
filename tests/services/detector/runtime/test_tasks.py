"""Models for rotated boxes, poses and whole images find what a bare call of Ultralytics finds, number by number."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.detections import Detection
from services.detector.model import DetectedObjects, ModelError
from services.detector.runtime.candidates import Candidates
from services.detector.runtime.criteria import Criteria
from services.detector.runtime.letterbox import Letterbox
from services.detector.runtime.loading import load
from services.detector.runtime.model_file import Task
from services.detector.runtime.object_shapes import corners_of, rotated_suppressed
from services.detector.runtime.postprocess import Output, objects
from services.detector.settings import DetectorSettings
from services.geometry.masks import decode
from tests.services.detector.runtime.bare_calls import SIDE, built_file, picture
from tests.services.detector.support.requests import request

pytestmark = pytest.mark.usefixtures("shut_network")


def ours(file: Path, image: NDArray[np.uint8], folder: Path, **options: object) -> list[Detection]:
    chosen = {"runtime": "torch", "device": "cpu", "image_size": SIDE, "cache": folder / "of tasks", **options}
    model = load(DetectorSettings.model_validate({"model": str(file), **chosen}), folder / "ultralytics")
    try:
        (outcome,) = model.run([request(image, masks=True)])
    finally:
        model.close()
    assert isinstance(outcome, DetectedObjects), outcome
    return outcome.objects


def bare(file: Path, image: NDArray[np.uint8], **options: object) -> Any:
    """Return what Ultralytics finds."""
    from ultralytics.models import YOLO  # noqa: PLC0415 - it must be offline by then

    model: Any = YOLO(file)
    (found,) = model.predict(image, imgsz=SIDE, device="cpu", verbose=False, **options)
    return found


def order(scores: Any) -> NDArray[np.intp]:
    """Return the best first; equal scores have no order, and there are none here."""
    return np.argsort(-np.asarray(scores))


@pytest.mark.parametrize(
    ("architecture", "runtime", "options"),
    [
        ("yolo11n-obb.yaml", "torch", {}),
        ("yolo26n-obb.yaml", "torch", {}),
        ("yolo26n-obb.yaml", "onnx", {"nms": False}),
    ],
)
def test_rotated_boxes(
    architecture: str, runtime: str, options: dict[str, Any], files: dict[str, Path], model_folder: Path
) -> None:
    file, image = built_file(architecture, files), picture()
    found = ours(file, image, model_folder, runtime=runtime, confidence=0.1, **options)
    expected = bare(file, image, conf=0.1, **options).obb
    assert len(found) == len(expected) >= 3
    turned = [each.rotated for each in found]
    rows = np.array([(each.x, each.y, each.width, each.height, each.angle) for each in turned if each is not None])
    theirs = expected.xywhr.numpy()[order(expected.conf)]
    assert rows[:, :4] == pytest.approx(theirs[:, :4], abs=0.5, rel=0.01)
    assert np.sin(rows[:, 4] - theirs[:, 4]) == pytest.approx(0, abs=1e-3)
    assert [each.label for each in found] == expected.cls.numpy()[order(expected.conf)].tolist()
    for each in found:
        assert each.rotated is not None
        assert each.mask is not None
        corners = corners_of(each.rotated)
        window = decode(each.mask)
        shown = np.zeros(image.shape[:2], np.uint8)
        cv2.fillPoly(shown, [np.rint((corners - 0.5) * 16).astype(np.int32)], 1, shift=4)
        drawn = np.zeros(image.shape[:2], np.uint8)
        drawn[window.place] = window.pixels
        assert np.abs(shown.astype(int) - drawn).sum() <= 0.02 * shown.sum() + 8
        rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
        ends = columns[0], rows[0], columns[-1] + 1, rows[-1] + 1
        assert (each.box.x1, each.box.y1, each.box.x2, each.box.y2) == pytest.approx(ends, abs=2)


def rotated(x: float, y: float, width: float, height: float, angle: float) -> list[Detection]:
    """Return what is read off an output that has one rotated box, in an image of the input's size."""
    numbers = np.array([x, y, width, height, 0.9, angle], np.float32)[:, None]
    letterbox = Letterbox.fit(480, 640, 640, 32)
    return objects(Output(numbers, None), letterbox, Criteria(), {0: "box"}, masks=True, task=Task("obb"))


def test_the_upright_box_is_around_what_is_in_the_image() -> None:
    (corner,) = rotated(5, 5, 4, 200, 0.7)
    assert corner.mask is not None
    window = decode(corner.mask)
    high, wide = window.pixels.shape
    assert corner.box.x2 == pytest.approx(window.left + wide, abs=1.5)
    assert corner.box.y2 == pytest.approx(window.top + high, abs=1.5)
    assert corner.box.x2 < 20
    assert rotated(-20, -20, 4, 200, 0.7) == rotated(-20, 100, 20, 20, 0) == []
    (whole,) = rotated(320, 240, 9_000, 9_000, 0.4)
    assert (whole.box.x1, whole.box.y1, whole.box.x2, whole.box.y2) == (0, 0, 640, 480)


@pytest.mark.parametrize("iou", [0.1, 0.5, 0.9])
def test_rotated_boxes_are_suppressed_as_ultralytics_does(iou: float, model_folder: Path) -> None:
    del model_folder  # Ultralytics is offline by then
    import torch  # noqa: PLC0415
    from ultralytics.utils.metrics import batch_probiou  # noqa: PLC0415
    from ultralytics.utils.nms import TorchNMS  # noqa: PLC0415

    rng = np.random.default_rng(5)
    middles, sides = rng.uniform(0, 200, (700, 2)), rng.uniform(4, 80, (700, 2))
    angles, labels = rng.uniform(-1, 2.3, 700), rng.integers(0, 2, 700)
    corners = np.concatenate([middles - sides / 2, middles + sides / 2], axis=1).astype(np.float32)
    scores = np.linspace(1, 0, 700, dtype=np.float32)
    found = Candidates(corners, scores, labels, angles[:, None].astype(np.float32))
    apart = np.concatenate([middles + labels[:, None] * 7680, sides, angles[:, None]], axis=1)
    expected = TorchNMS.fast_nms(torch.tensor(apart), torch.tensor(scores), iou, iou_func=batch_probiou).numpy()
    assert rotated_suppressed(found, labels, iou, 700).tolist() == expected.tolist()
    assert rotated_suppressed(found, labels, iou, 20).tolist() == expected[:20].tolist()
    assert 20 < len(expected) < 700


@pytest.mark.parametrize(
    ("architecture", "runtime", "options"),
    [
        ("yolo11n-pose.yaml", "torch", {}),
        ("yolo26n-pose.yaml", "torch", {}),
        ("yolo26n-pose.yaml", "onnx", {"nms": False}),
    ],
)
def test_keypoints(
    architecture: str, runtime: str, options: dict[str, Any], files: dict[str, Path], model_folder: Path
) -> None:
    file, image = built_file(architecture, files), picture()
    found = ours(file, image, model_folder, runtime=runtime, **options)
    expected = bare(file, image, **options)
    which = order(expected.boxes.conf)
    assert len(found) == len(which) >= 3
    points = np.array([[(at.x, at.y, at.score) for at in each.keypoints or ()] for each in found])
    theirs = expected.keypoints.data.numpy()[which]
    assert points.shape == (len(found), 17, 3)
    assert points[..., 2] == pytest.approx(theirs[..., 2], abs=2e-3)
    assert points[..., :2] == pytest.approx(theirs[..., :2], abs=0.2)
    assert [each.mask for each in found] == [None] * len(found)


def fine(height: int, width: int) -> NDArray[np.uint8]:
    """Return a picture with stripes that are gone where it is made smaller by averages, and not otherwise."""
    stripes = np.arange(width) // 3 % 2 * 120
    coarse = cv2.resize(picture(), (width, height), interpolation=cv2.INTER_CUBIC) // 2
    return np.asarray(coarse + stripes[None, :, None], np.uint8)


@pytest.mark.parametrize("runtime", ["torch", "onnx"])
def test_classes_of_a_whole_image(runtime: str, files: dict[str, Path], model_folder: Path) -> None:
    file = built_file("yolo11n-cls.yaml", files)
    for image in (picture(), fine(1080, 1920), fine(700, 300), picture(SIDE, SIDE)):
        found = ours(file, image, model_folder, runtime=runtime, confidence=0.05)
        expected = bare(file, image).probs.data.numpy()
        assert len(found) >= 2
        assert [each.label for each in found] == [n for n in order(expected) if expected[n] > 0.05]
        assert [each.score for each in found] == pytest.approx(sorted(expected, reverse=True)[: len(found)], abs=2e-3)
        height, width = image.shape[:2]
        assert {(each.box.x1, each.box.y1, each.box.x2, each.box.y2) for each in found} == {(0, 0, width, height)}
        assert [each.mask for each in found] == [None] * len(found)


def test_an_input_for_classifying_is_the_one_of_a_bare_call(model_folder: Path) -> None:
    del model_folder  # Ultralytics is offline by then
    from PIL import Image  # noqa: PLC0415
    from ultralytics.data.augment import classify_transforms  # noqa: PLC0415

    for height, width, size in (
        (1080, 1920, (224, 224)),
        (1380, 640, (224, 224)),
        (90, 150, (128, 128)),
        (90, 150, (128, 256)),
    ):
        image = fine(height, width)
        given = np.empty((*size, 3), np.uint8)
        Letterbox.crop(height, width, size).apply(image, given)
        bare_size = size[0] if size[0] == size[1] else size
        tensor = classify_transforms(bare_size)(Image.fromarray(np.ascontiguousarray(image[..., ::-1])))
        theirs = (tensor.numpy().transpose(1, 2, 0) * 255).round()
        assert np.abs(given - theirs).max() <= 3
        assert np.abs(given - theirs).mean() < 0.6


def test_an_image_that_is_long_and_thin_is_cut_before_it_is_enlarged() -> None:
    given = np.empty((1280, 1280, 3), np.uint8)
    Letterbox.crop(1, 16_384, (1280, 1280)).apply(np.full((1, 16_384, 3), 7, np.uint8), given)
    assert (given == 7).all()


def test_a_model_that_classifies_pictures_of_another_mean_is_refused(
    files: dict[str, Path], model_folder: Path
) -> None:
    import torch  # noqa: PLC0415 - after `keep_offline`
    from ultralytics.data.augment import classify_transforms  # noqa: PLC0415

    whole = torch.load(built_file("yolo11n-cls.yaml", files), weights_only=False)
    for mean, refused in (((0.0, 0.0, 0.0), False), ((0.485, 0.456, 0.406), True)):
        whole["model"].transforms = classify_transforms(SIDE, mean=mean)
        torch.save(whole, files[""] / "other-mean.pt")
        if not refused:
            ours(files[""] / "other-mean.pt", picture(), model_folder)
            continue
        with pytest.raises(ModelError, match="it is for images of another mean and spread"):
            ours(files[""] / "other-mean.pt", picture(), model_folder)


def test_what_is_silent_is_said_of_poses(files: dict[str, Path], model_folder: Path) -> None:
    chosen = {"model": str(built_file("yolo11n-pose.yaml", files)), "runtime": "torch", "device": "cpu"}
    model = load(DetectorSettings.model_validate(chosen), model_folder / "ultralytics")
    model.close()
    assert model.remarks == ("yolo11n-pose-built.pt has no masks: overlay/segmentation and objects are not published",)


def test_settings_choose_among_classes_of_a_whole_image(files: dict[str, Path], model_folder: Path) -> None:
    file = built_file("yolo11n-cls.yaml", files)
    best, *others = ours(file, picture(), model_folder, confidence=0.05)
    assert [each.label for each in ours(file, picture(), model_folder, confidence=0.05, classes=[best.name])] == [
        best.label
    ]
    assert len(ours(file, picture(), model_folder, confidence=0.05, max_detections=1)) == 1
    one = ours(file, picture(), model_folder, confidence=0.05, class_names=[f"{others[0].name}={best.name}"])
    assert [each.name for each in one] == list(dict.fromkeys([best.name, *(each.name for each in others[1:])]))


def test_a_model_that_classifies_has_no_head_to_choose(files: dict[str, Path], model_folder: Path) -> None:
    with pytest.raises(ModelError, match="a model that classifies whole images finds no boxes: leave it out"):
        ours(built_file("yolo11n-cls.yaml", files), picture(), model_folder, nms=True)
