"""Models for rotated boxes, poses and whole images find what a bare call of Ultralytics finds, number by number."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.detections import Detection
from services.detector.model import DetectedObjects, ModelError
from services.detector.runtime.candidates import Candidates
from services.detector.runtime.loading import load
from services.detector.runtime.object_shapes import corners_of, rotated_suppressed
from services.detector.settings import DetectorSettings
from services.geometry.masks import decode
from tests.services.detector.runtime.bare_calls import SIDE, picture
from tests.services.detector.support.requests import request

pytestmark = pytest.mark.usefixtures("shut_network")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return the model files built so far, by architecture."""
    return {"": tmp_path_factory.mktemp("models")}


def file_of(architecture: str, files: dict[str, Path]) -> Path:
    """Return a model file of an architecture, built if there is none yet."""
    from tests.services.detector.runtime import built_models  # noqa: PLC0415 - after `keep_offline`

    if architecture not in files:
        model = built_models.build(architecture)
        files[architecture] = built_models.write(model, files[""] / architecture.replace(".yaml", "-built.pt"))
    return files[architecture]


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
        ("yolo11n-obb.yaml", "onnx", {}),
        ("yolo26n-obb.yaml", "torch", {}),
        ("yolo26n-obb.yaml", "onnx", {"nms": False}),
    ],
)
def test_rotated_boxes(
    architecture: str, runtime: str, options: dict[str, Any], files: dict[str, Path], model_folder: Path
) -> None:
    file, image = file_of(architecture, files), picture()
    found = ours(file, image, model_folder, runtime=runtime, confidence=0.1, **options)
    expected = bare(file, image, conf=0.1, **options).obb
    assert len(found) == len(expected) >= 3
    turned = [each.rotated for each in found]
    rows = np.array([(each.x, each.y, each.width, each.height, each.angle) for each in turned if each is not None])
    theirs = expected.xywhr.numpy()[order(expected.conf)]
    assert rows[:, :4] == pytest.approx(theirs[:, :4], abs=0.5, rel=0.01)
    assert np.sin(rows[:, 4] - theirs[:, 4]) == pytest.approx(0, abs=1e-3)
    assert [each.label for each in found] == expected.cls.numpy()[order(expected.conf)].tolist()
    height, width = image.shape[:2]
    for each in found:
        assert each.rotated is not None
        assert each.mask is not None
        corners = corners_of(each.rotated)
        ends = np.clip([*corners.min(axis=0), *corners.max(axis=0)], 0, [width, height] * 2)
        assert (each.box.x1, each.box.y1, each.box.x2, each.box.y2) == pytest.approx(ends.tolist(), abs=1e-3)
        if corners.min() > 4 and (corners.max(axis=0) < [width - 4, height - 4]).all():
            area = each.rotated.width * each.rotated.height
            assert decode(each.mask).area == pytest.approx(area, abs=each.rotated.width + each.rotated.height + 4)


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
        ("yolo11n-pose.yaml", "onnx", {}),
        ("yolo26n-pose.yaml", "torch", {}),
        ("yolo26n-pose.yaml", "onnx", {"nms": False}),
    ],
)
def test_keypoints(
    architecture: str, runtime: str, options: dict[str, Any], files: dict[str, Path], model_folder: Path
) -> None:
    file, image = file_of(architecture, files), picture()
    found = ours(file, image, model_folder, runtime=runtime, **options)
    expected = bare(file, image, **options)
    which = order(expected.boxes.conf)
    assert len(found) == len(which) >= 3
    points = np.array([[(at.x, at.y, at.score) for at in each.keypoints or ()] for each in found])
    theirs = expected.keypoints.data.numpy()[which]
    assert points.shape == (len(found), 17, 3)
    assert points[..., 2] == pytest.approx(theirs[..., 2], abs=2e-3)
    assert points[..., :2] == pytest.approx(theirs[..., :2], abs=0.2)
    for each in found:
        assert each.mask is not None
        mask = decode(each.mask)
        for at in each.keypoints or ():
            if at.score >= 0.5 and at.x < image.shape[1] and at.y < image.shape[0]:
                assert mask.pixels[int(at.y) - mask.top, int(at.x) - mask.left]


@pytest.mark.parametrize("runtime", ["torch", "onnx"])
def test_classes_of_a_whole_image(runtime: str, files: dict[str, Path], model_folder: Path) -> None:
    file = file_of("yolo11n-cls.yaml", files)
    for image in (picture(), picture(200, 60), picture(SIDE, SIDE)):
        found = ours(file, image, model_folder, runtime=runtime, confidence=0.05)
        expected = bare(file, image).probs.data.numpy()
        assert len(found) >= 2
        assert [each.label for each in found] == [n for n in order(expected) if expected[n] > 0.05]
        assert [each.score for each in found] == pytest.approx(sorted(expected, reverse=True)[: len(found)], abs=0.05)
        height, width = image.shape[:2]
        assert {(each.box.x1, each.box.y1, each.box.x2, each.box.y2) for each in found} == {(0, 0, width, height)}
        assert [each.mask for each in found] == [None] * len(found)


def test_settings_choose_among_classes_of_a_whole_image(files: dict[str, Path], model_folder: Path) -> None:
    file = file_of("yolo11n-cls.yaml", files)
    best, *others = ours(file, picture(), model_folder, confidence=0.05)
    assert [each.label for each in ours(file, picture(), model_folder, confidence=0.05, classes=[best.name])] == [
        best.label
    ]
    assert len(ours(file, picture(), model_folder, confidence=0.05, max_detections=1)) == 1
    one = ours(file, picture(), model_folder, confidence=0.05, class_names=[f"{others[0].name}={best.name}"])
    assert [each.name for each in one] == list(dict.fromkeys([best.name, *(each.name for each in others[1:])]))


def test_a_model_that_classifies_has_no_head_to_choose(files: dict[str, Path], model_folder: Path) -> None:
    with pytest.raises(ModelError, match="a model that classifies whole images finds no boxes: leave it out"):
        ours(file_of("yolo11n-cls.yaml", files), picture(), model_folder, nms=True)
