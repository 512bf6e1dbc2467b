from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.detections import Box, Detection
from services.detector.runtime.offline import keep_offline
from tests.services.detector.requests import frame_of


@pytest.mark.parametrize("kind", ["bytetrack", "botsort"])
def test_what_moves_a_little_keeps_its_number_and_what_leaves_takes_it_along(kind: str, model_folder: Path) -> None:
    keep_offline(model_folder / "ultralytics", download=False)
    from services.detector.runtime.trackers import UltralyticsTracker  # noqa: PLC0415 - it must be offline by then

    tracker = UltralyticsTracker("botsort" if kind == "botsort" else "bytetrack")
    picture = np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8)

    def seen(step: int, *lefts: float) -> list[int | None]:
        objects = [Detection(name="box", score=0.8, box=Box(x, 20, x + 40, 60)) for x in lefts]
        return list(tracker.update(objects, frame_of(picture, seq=step)))

    first = seen(0, 10, 100, 200)
    assert sorted(number for number in first if number is not None) == [1, 2, 3]
    for step in range(1, 5):
        assert seen(step, 10 + step, 100 - step, 200) == first
    assert seen(5, 200, 15) == [first[2], first[0]]
    assert seen(6) == []


def textured(height: int, width: int) -> NDArray[np.uint8]:
    """Return a picture with corners to hold on to."""
    coarse = np.random.default_rng(1).integers(0, 255, (height // 20, width // 20, 3), np.uint8)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)


@pytest.mark.parametrize(("kind", "followed"), [("botsort", True), ("bytetrack", False)])
def test_only_who_looks_at_the_image_follows_when_the_camera_swings(
    kind: str, *, followed: bool, model_folder: Path
) -> None:
    keep_offline(model_folder / "ultralytics", download=False)
    from services.detector.runtime.trackers import UltralyticsTracker  # noqa: PLC0415 - it must be offline by then

    tracker = UltralyticsTracker("botsort" if kind == "botsort" else "bytetrack")
    wide = textured(480, 960)

    def seen(step: int, swung: int) -> int | None:
        box = Box(400 - swung, 200, 440 - swung, 240)
        frame = frame_of(np.ascontiguousarray(wide[:, swung : swung + 640]), seq=step)
        (number,) = tracker.update([Detection(name="box", score=0.9, box=box)], frame)
        return number

    numbers = [seen(step, swung) for step, swung in enumerate(range(0, 250, 50))]
    assert (set(numbers) == {1}) is followed


def test_the_cameras_motion_is_in_pixels_of_its_image_and_starts_over_with_another_size(model_folder: Path) -> None:
    keep_offline(model_folder / "ultralytics", download=False)
    from services.detector.runtime.trackers import CameraMotion  # noqa: PLC0415 - it must be offline by then

    wide, motion = textured(480, 960), CameraMotion()

    def seen(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
        return motion.apply(motion.look(frame_of(np.ascontiguousarray(picture))))

    assert np.array_equal(seen(wide[:, :640]), np.eye(2, 3))
    moved = seen(wide[:, 60:700])
    assert moved[:, 2] == pytest.approx([-60, 0], abs=3)
    assert moved[:, :2] == pytest.approx(np.eye(2), abs=0.02)
    small = np.zeros((48, 64, 3), np.uint8)
    for picture in (small, small, wide):
        assert np.array_equal(seen(picture), np.eye(2, 3))


@pytest.mark.parametrize(("score", "followed"), [(0.3, False), (0.4, True)])
def test_only_what_is_sure_begins_a_track_and_goes_on_when_it_is_less_so(
    score: float, *, followed: bool, model_folder: Path
) -> None:
    keep_offline(model_folder / "ultralytics", download=False)
    from services.detector.runtime.trackers import UltralyticsTracker  # noqa: PLC0415 - it must be offline by then

    tracker = UltralyticsTracker("botsort")
    picture = textured(240, 320)

    def seen(step: int, left: float, score: float) -> int | None:
        box = Detection(name="box", score=score, box=Box(left, 20, left + 40, 60))
        (number,) = tracker.update([box], frame_of(picture, seq=step))
        return number

    numbers = [seen(0, 10, score), *(seen(step, 10 + 12 * step, 0.26) for step in range(1, 4))]
    assert numbers == ([1] * 4 if followed else [None] * 4)
