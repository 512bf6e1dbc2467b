from collections.abc import Iterable, Sequence

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.accuracy.drives import HZ, DriveFrame, HeldOutDrive, Seen
from benchmarks.accuracy.following import Overlap, Tally, box_overlap, followed, mask_overlap, sighting
from benchmarks.accuracy.identities import Identities
from schemas.detections import Box, Detection
from tests.benchmarks.accuracy.seen import Place, seen
from tests.services.training.evaluation.pictures import found

HERE: Place = (10, 10, 50, 50)
THERE: Place = (100, 10, 140, 50)


@pytest.fixture(params=[box_overlap, mask_overlap], ids=["boxes", "masks"])
def overlap(request: pytest.FixtureRequest) -> Overlap:
    chosen: Overlap = request.param
    return chosen


def tracked(place: Place, track: int | None, *, name: str = "box") -> Detection:
    return msgspec.structs.replace(found(name, *place), track=track)


def test_a_track_lies_on_an_object_of_its_class(overlap: Overlap) -> None:
    here = sighting([seen(3, HERE), seen(4, THERE)], [tracked(THERE, 7), tracked(HERE, 8, name="pallet")], overlap)
    assert (here.frame.identities, here.frame.tracks, here.detected) == ([3, 4], [7, 8], 1)
    assert here.frame.overlap.tolist() == [[0, 0], [1, 0]]


def test_what_has_no_track_is_detected_alone(overlap: Overlap) -> None:
    here = sighting([seen(3, HERE)], [tracked(HERE, None)], overlap)
    assert (here.frame.tracks, here.frame.overlap.shape, here.detected) == ([], (1, 0), 1)


def test_of_several_on_one_object_one_detects_it(overlap: Overlap) -> None:
    here = sighting([seen(3, HERE)], [tracked(HERE, 7), tracked((10, 10, 50, 45), 8)], overlap)
    assert (here.frame.tracks, here.detected) == ([7, 8], 1)


@pytest.mark.parametrize(
    ("place", "name", "counted"),
    [
        (HERE, "box", False),  # the object that is not asked for
        ((10, 10, 20, 20), "box", False),  # a part of it
        ((10, 10, 90, 50), "box", False),  # half on it
        ((10, 10, 91, 50), "box", True),  # less than half
        (HERE, "pallet", True),  # another class
        (THERE, "box", True),  # nothing there
    ],
)
def test_what_is_not_asked_for_is_ignored_both_ways(
    place: Place, name: str, overlap: Overlap, *, counted: bool
) -> None:
    here = sighting([seen(3, HERE, asked_for=False)], [tracked(place, 7, name=name)], overlap)
    assert here.frame.identities == []
    assert here.frame.tracks == ([7] if counted else [])


def test_a_match_of_an_object_asked_for_is_not_ignored_for_what_it_lies_on_too(overlap: Overlap) -> None:
    asked, other = seen(3, HERE), seen(4, HERE, asked_for=False)
    here = sighting([asked, other], [tracked(HERE, 7), tracked((10, 10, 50, 48), 8)], overlap)
    assert here.frame.tracks == [7]


def test_nothing_seen_and_nothing_found(overlap: Overlap) -> None:
    here = sighting([], [], overlap)
    assert (here.frame.identities, here.frame.tracks, here.frame.overlap.shape) == ([], [], (0, 0))


def drive(*frames: Sequence[Seen]) -> HeldOutDrive:
    _, png = cv2.imencode(".png", np.zeros((100, 200, 3), np.uint8))
    made = [DriveFrame(png=png.tobytes(), seen=list(each), depth_png=b"", pose=[]) for each in frames]
    return HeldOutDrive(seed=1, frames=made)


def test_drives_add_up_each_with_identities_of_its_own() -> None:
    asked: list[float] = []
    tracks = iter([1, 1, 2, 3])

    def follow(images: Iterable[NDArray[np.uint8]], hz: float) -> list[Sequence[Detection]]:
        asked.append(hz)
        return [[tracked(HERE, next(tracks))] if image.shape == (100, 200, 3) else [] for image in images]

    done: list[int] = []
    same = drive([seen(3, HERE)], [seen(3, HERE)])
    total = followed([same, same], follow, done.append)
    assert total.boxes == total.masks == Tally(Identities(true=4, tracked=4, matched=4, rightly=3, switches=1), 4)
    assert (total.frames, done, asked) == (4, [1, 2], [HZ, HZ])


def test_by_boxes_a_mask_may_be_thin_and_by_masks_a_box_may_be_wide() -> None:
    thin = msgspec.structs.replace(tracked((10, 10, 50, 20), 7), box=Box(10, 10, 50, 50))
    wide = msgspec.structs.replace(tracked(HERE, 7), box=Box(10, 10, 200, 50))
    assert [sighting([seen(3, HERE)], [each], box_overlap).detected for each in (thin, wide)] == [1, 0]
    assert [sighting([seen(3, HERE)], [each], mask_overlap).detected for each in (thin, wide)] == [0, 1]


def test_an_object_that_is_not_asked_for_for_a_while_keeps_its_identity() -> None:
    tracks = iter([[7], [7], [], [7]])

    def follow(images: Iterable[NDArray[np.uint8]], hz: float) -> list[Sequence[Detection]]:
        assert hz == HZ
        return [[tracked(HERE, track) for track in next(tracks)] for _ in images]

    asked = [seen(3, HERE, asked_for=asked_for) for asked_for in (True, False, False, True)]
    total = followed([drive(*([each] for each in asked))], follow, lambda _: None)
    assert total.boxes == total.masks == Tally(Identities(true=2, tracked=2, matched=2, rightly=2), 2)
