from pathlib import Path
from typing import Any
from unittest.mock import ANY

import numpy as np
import pytest
from pydantic import ValidationError
from ultralytics.models import YOLO

from services.detector.model import DetectedObjects, ModelError
from services.detector.pixels import to_bgr
from services.detector.runtime.loading import load
from services.detector.settings import SHIPPED_MODEL, DetectorSettings
from services.simulator.world import CLASSES
from services.toolbox.train.inference import framed, open_follower, open_weights
from services.training.evaluation.predictor import CONFIDENCE, Predictor
from tests.services.detector.support.requests import request
from tests.services.simulator.views import near_view


def opened(weights: Path, folder: Path) -> Predictor:
    return open_weights(weights, confidence=CONFIDENCE, device="cpu", folder=folder)


def untrained(architecture: str, folder: Path, *names: str) -> Path:
    """Write a model that was never trained."""
    yolo: Any = YOLO(architecture)
    path = folder / architecture.replace("yaml", "pt")
    if names:
        yolo.model = type(yolo.model)(architecture, nc=len(names), verbose=False)
        yolo.model.task, yolo.model.names = yolo.task, dict(enumerate(names))
    yolo.save(path)
    return path


def test_the_weights_see_what_a_detector_sees(tmp_path: Path) -> None:
    bgr = near_view()
    found = opened(SHIPPED_MODEL, tmp_path)(np.ascontiguousarray(bgr[..., ::-1]))
    assert found
    model = load(DetectorSettings(device="cpu", threads=1, runtime="torch"), tmp_path)
    assert model.run([request(bgr, masks=True)]) == [DetectedObjects(list(found), ANY)]
    assert {each.mask.size for each in found if each.mask is not None} == {(480, 640)}


def test_the_confidence_that_counts_is_a_detectors_default() -> None:
    assert DetectorSettings().confidence == CONFIDENCE


def test_a_picture_is_framed_with_its_own_colours() -> None:
    image = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    assert np.array_equal(to_bgr(framed(image)), image[..., ::-1])


def test_what_is_no_model_is_refused(tmp_path: Path) -> None:
    weights = tmp_path / "x.pt"
    with pytest.raises(ValidationError, match="no such file"):
        opened(weights, tmp_path)
    weights.write_bytes(b"nothing of the kind")
    with pytest.raises(ModelError, match=r"x\.pt: not a model that can be used"):
        opened(weights, tmp_path)


@pytest.mark.parametrize(
    ("architecture", "names", "reason"),
    [
        ("yolo11n.yaml", CLASSES, "yolo11n.pt: a model for detection, not for segmentation"),
        (
            "yolo11n-seg.yaml",
            ("box", "person", "cat"),
            "a model for cat, person; the scenes have box, pallet, forklift",
        ),
        ("yolo11n-seg.yaml", (), "a model for 0, 1, 10, 11, 12, ...; the scenes have"),
        ("yolo11n-pose.yaml", (), "a model for poses, not for segmentation"),
    ],
)
def test_a_model_for_something_else_is_refused(
    tmp_path: Path, architecture: str, names: tuple[str, ...], reason: str
) -> None:
    with pytest.raises(ModelError, match=reason):
        opened(untrained(architecture, tmp_path, *names), tmp_path)


def test_objects_are_followed_from_picture_to_picture_of_a_drive_and_never_into_the_next(tmp_path: Path) -> None:
    follow = open_follower(SHIPPED_MODEL, device="cpu", folder=tmp_path)
    rgb = np.ascontiguousarray(near_view()[..., ::-1])
    one, other = ([{each.track for each in found} - {None} for found in follow([rgb] * 4, 5.0)] for _ in range(2))
    assert one[-1], "a number once it is sure"
    assert one[-1] == one[-2]
    assert other[-1]
    assert one[-1].isdisjoint(other[-1])
