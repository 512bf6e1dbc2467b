from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.detections import Box, Detection
from schemas.tuning import Tuning
from services.detector.runtime.loading import tracking
from services.detector.runtime.offline import keep_offline
from services.detector.settings import DetectorSettings
from services.detector.tracking.confirmed_tracks import NEUTRAL, neutral_score
from services.detector.tracking.tracks import Tracker
from tests.services.detector.support.fakes import FakeModel
from tests.services.detector.support.requests import frame_of


@pytest.mark.parametrize("kind", ["bytetrack", "botsort"])
def test_what_moves_a_little_keeps_its_number_and_what_leaves_takes_it_along(kind: str, model_folder: Path) -> None:
    tracker = tracker_in(model_folder, kind)
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


def tracker_in(model_folder: Path, kind: str = "botsort") -> Tracker:
    keep_offline(model_folder / "ultralytics", download=False)
    from services.detector.tracking.trackers import CameraTracker  # noqa: PLC0415 - it must be offline by then

    return CameraTracker("botsort" if kind == "botsort" else "bytetrack")


@pytest.mark.parametrize("kind", ["bytetrack", "botsort"])
@pytest.mark.parametrize("score", [0.26, 0.3, 0.33])
def test_a_steady_object_of_a_model_that_is_not_known_has_a_number_at_most_a_frame_after_ultralytics_own(
    kind: str, score: float, model_folder: Path
) -> None:
    keep_offline(model_folder / "ultralytics", download=False)
    from ultralytics.engine.results import Boxes  # noqa: PLC0415 - it must be offline by then
    from ultralytics.trackers.bot_sort import BOTSORT  # noqa: PLC0415 - as above
    from ultralytics.trackers.byte_tracker import BYTETracker  # noqa: PLC0415 - as above
    from ultralytics.utils import ROOT, YAML, IterableSimpleNamespace  # noqa: PLC0415 - as above

    from services.detector.tracking.trackers import CameraTracker  # noqa: PLC0415 - as above

    args = IterableSimpleNamespace(**YAML.load(ROOT / "cfg" / "trackers" / f"{kind}.yaml"))
    theirs = BOTSORT(args) if kind == "botsort" else BYTETracker(args)
    tracker = CameraTracker("botsort" if kind == "botsort" else "bytetrack", lambda: neutral_score(0.25))
    picture = textured(240, 320)

    def numbers(first: int) -> tuple[list[int], list[int]]:
        """Show both the same object, and return in which frames of it each gives it a number."""
        ours, bare = [], []
        for step in range(first, first + 6):
            box = Box(10 + 100 * (first > 0), 20, 50 + 100 * (first > 0), 60)
            found = [Detection(name="box", score=score, box=box)]
            if tracker.update(found, frame_of(picture, seq=step)) != [None]:
                ours.append(step - first)
            row = np.array([[box.x1, box.y1, box.x2, box.y2, score, 0]], np.float32)
            if len(theirs.update(Boxes(row, (240, 320)), picture)):
                bare.append(step - first)
        return ours, bare

    for first in (0, 6):
        ours, bare = numbers(first)
        assert ours[0] <= (bare[0] + 1 if bare else 2)  # later than in the first frame, low scores have none there


@pytest.mark.parametrize(("kind", "sightings"), [("botsort", 2), ("bytetrack", 3)])
@pytest.mark.parametrize(
    ("confidence", "score"), [(0.1, 0.2), (0.1, 0.1), (0.05, 0.06), (0.0, 0.01), (0.25, 0.25), (0.6, 0.6), (0.9, 0.9)]
)
def test_an_object_that_is_reported_a_few_times_has_a_number_whatever_the_confidence_and_also_once_it_is_tuned(
    kind: str, sightings: int, confidence: float, score: float, model_folder: Path
) -> None:
    keep_offline(model_folder / "ultralytics", download=False)
    from services.detector.tracking.trackers import CameraTracker  # noqa: PLC0415 - it must be offline by then

    chosen = [0.95]
    tracker = CameraTracker("botsort" if kind == "botsort" else "bytetrack", lambda: neutral_score(chosen[0]))
    picture = textured(240, 320)
    assert list(tracker.update([], frame_of(picture, seq=0))) == []
    chosen[0] = confidence
    found = [Detection(name="box", score=score, box=Box(10, 20, 50, 60))]
    numbers = [list(tracker.update(found, frame_of(picture, seq=1 + step))) for step in range(sightings)]
    assert numbers[-1] == [1]


def follower(model_folder: Path, hz: int = 5) -> Callable[..., int | None]:
    """Return what shows a tracker a thing, or None, in a picture that stays as it is, and returns its number."""
    tracker, picture = tracker_in(model_folder), textured(240, 320)

    def seen(step: int, left: float | None, score: float, label: int = 0) -> int | None:
        frame = frame_of(picture, seq=step)
        header = msgspec.structs.replace(frame.header, received_ns=1_000_000_000 * step // hz)
        things = []
        if left is not None:
            box = Box(left, 20, left + 40, 60)
            things.append(Detection(name=f"class {label}", label=label, score=score, box=box))
        return next(iter(tracker.update(things, msgspec.structs.replace(frame, header=header))), None)

    return seen


@pytest.mark.parametrize(("kind", "followed"), [("botsort", True), ("bytetrack", False)])
def test_only_who_looks_at_the_image_follows_when_the_camera_swings(
    kind: str, *, followed: bool, model_folder: Path
) -> None:
    tracker = tracker_in(model_folder, kind)
    wide = textured(480, 960)

    def seen(step: int, swung: int) -> int | None:
        box = Box(400 - swung, 200, 440 - swung, 240)
        frame = frame_of(np.ascontiguousarray(wide[:, swung : swung + 640]), seq=step)
        (number,) = tracker.update([Detection(name="box", score=0.9, box=box)], frame)
        return number

    numbers = [seen(step, swung) for step, swung in enumerate(range(0, 250, 50))]
    assert (set(numbers) == {1}) is followed


@pytest.mark.parametrize(("score", "number"), [(0.26, None), (0.6, 1)])
def test_what_was_seen_well_goes_on_when_it_is_less_so_and_what_was_not_has_no_number(
    score: float, number: int | None, model_folder: Path
) -> None:
    seen = follower(model_folder)
    numbers = [seen(step, 10 + 12 * step, score if step == 0 else 0.36) for step in range(4)]
    assert numbers == [number] * 4


@pytest.mark.parametrize(("kind", "numbers"), [("botsort", [1, 2]), ("bytetrack", [1, None])])
def test_only_who_knows_places_well_gives_numbers_at_first_sight(
    kind: str, numbers: list[int | None], model_folder: Path
) -> None:
    """The second of two things comes into view in the second frame."""
    tracker, picture = tracker_in(model_folder, kind), textured(240, 320)
    things = [Detection(name="box", score=0.6, box=Box(left, 20, left + 40, 60)) for left in (10, 200)]
    assert tracker.update(things[:1], frame_of(picture, seq=0)) == [1]
    assert tracker.update(things, frame_of(picture, seq=1)) == numbers


def test_a_detection_goes_on_with_a_track_of_its_class_alone(model_folder: Path) -> None:
    seen = follower(model_folder)
    labels = [0, 0, 1, 1, 0]
    assert [seen(step, 10 + 6 * label, 0.9, label) for step, label in enumerate(labels)] == [1, 1, 2, 2, 1]


@pytest.mark.parametrize("score", [0.2, 0.05])
def test_one_of_a_low_score_goes_on_with_a_track_of_its_class_alone_too(score: float, model_folder: Path) -> None:
    seen = follower(model_folder)
    sightings = [(0.9, 0), (score, 1), (score, 0), (0.9, 0)]
    assert [seen(step, 10, each, label) for step, (each, label) in enumerate(sightings)] == [1, None, 1, 1]


def test_what_had_low_scores_before_has_them_counted_against_it(model_folder: Path) -> None:
    seen = follower(model_folder)
    assert [seen(step, 10, score) for step, score in enumerate((0.2, 0.2, 0.2, 0.6))] == [None] * 4


@pytest.mark.parametrize(("hz", "frames", "number"), [(5, 10, 1), (5, 12, 2), (20, 40, 1), (20, 42, 2)])
def test_what_is_lost_is_looked_for_for_so_long_at_whatever_rate(
    hz: int, frames: int, number: int | None, model_folder: Path
) -> None:
    """It is seen again the given number of frames after it was seen last; as another thing if that is too late."""
    seen = follower(model_folder, hz)
    assert [seen(step, 10, 0.9) for step in range(2)] == [1, 1]
    for step in range(2, 1 + frames):
        seen(step, None, 0.9)
    assert seen(1 + frames, 10, 0.9) == number


def test_what_is_lost_among_a_camera_s_first_frames_is_found_again(model_folder: Path) -> None:
    seen = follower(model_folder)
    assert [seen(step, left, 0.9) for step, left in enumerate((10, None, None, None, 10))] == [1, None, None, None, 1]


def test_who_comes_into_view_over_several_frames_keeps_its_number(model_folder: Path) -> None:
    tracker, wide = tracker_in(model_folder), textured(480, 960)

    def seen(step: int, left: int) -> int | None:
        picture = np.ascontiguousarray(wide[:, 320 - left : 960 - left])
        box = Box(max(0, left - 200), 100, left - 10, 400)
        (number,) = tracker.update([Detection(name="box", score=0.9, box=box)], frame_of(picture, seq=step))
        return number

    assert {seen(step, left) for step, left in enumerate((30, 90, 150, 210))} == {1}


def test_another_cameras_tracker_takes_no_numbers_away(model_folder: Path) -> None:
    seen = follower(model_folder)
    assert seen(0, 10, 0.9) == 1
    follower(model_folder)
    assert seen(1, 200, 0.9) == 2


def test_an_image_of_a_few_pixels_is_no_hindrance(model_folder: Path) -> None:
    tracker = tracker_in(model_folder)
    box = Detection(name="box", score=0.9, box=Box(0, 0, 2, 2))
    for step in range(3):
        assert tracker.update([box], frame_of(np.zeros((2, 2, 3), np.uint8), seq=step)) == [1]


@pytest.mark.parametrize(
    ("fields", "confidence", "neutral"),
    [
        ({}, 0.25, NEUTRAL),
        ({}, 0.05, NEUTRAL),
        ({"model": "own.pt"}, 0.25, neutral_score(0.25)),
        ({"model": "own.pt"}, 0.05, neutral_score(0.05)),
        ({"detection_model": "own.pt"}, 0.05, neutral_score(0.05)),
        ({"model": "own.pt", "track_score": 0.4}, 0.05, 0.4),
        ({"track_score": 0.4}, 0.05, 0.4),
    ],
)
def test_the_score_that_speaks_for_a_track_follows_the_model_unless_it_is_given(
    fields: dict[str, Any], confidence: float, neutral: float, tmp_path: Path, model_folder: Path
) -> None:
    keep_offline(model_folder / "ultralytics", download=False)
    (tmp_path / "own.pt").touch()
    files = {name: str(tmp_path / value) for name, value in fields.items() if isinstance(value, str)}
    settings = DetectorSettings.model_validate({**fields, **files})
    model = FakeModel()
    following = tracking(settings, model)
    assert following is not None
    model.tune(Tuning(confidence=confidence))
    tracker: Any = following._make()
    following.close()
    assert tracker._neutral() == neutral
