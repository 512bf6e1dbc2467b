import asyncio
from collections.abc import Iterator, Sequence

import msgspec
import pytest

from schemas.detections import TRACK_COUNT_BITS, Box, Detection
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from services.detector.model import DetectedObjects, Request
from services.detector.tracking.tracks import GAP_NS, CameraTracks, Tracking
from tests.schemas.frames import header
from tests.services.detector.test_worker import frame

BOX = Detection(name="box", score=0.9, box=Box(0, 0, 2, 2))


class Counting:
    """Gives the objects of every frame the numbers from 1, and knows how many frames it saw."""

    def __init__(self) -> None:
        self.frames = 0

    def update(self, objects: Sequence[Detection], frame: ImageFrame) -> Sequence[int | None]:
        assert frame.header is not None
        self.frames += 1
        return [n if n < 3 else None for n, _ in enumerate(objects, 1)]


class Factory:
    def __init__(self) -> None:
        self.made: list[Counting] = []

    def __call__(self) -> Counting:
        self.made.append(Counting())
        return self.made[-1]


def at(about: Header) -> ImageFrame:
    return msgspec.structs.replace(frame(0), header=about)


def numbers(objects: list[Detection]) -> list[int | None]:
    return [each.track if each.track is None else each.track & ((1 << TRACK_COUNT_BITS) - 1) for each in objects]


def epoch(objects: list[Detection]) -> int:
    assert objects[0].track is not None
    return objects[0].track >> TRACK_COUNT_BITS


def followed(*headers: Header) -> tuple[list[list[Detection]], Factory]:
    factory = Factory()
    tracks = CameraTracks(factory)
    return [tracks.follow([BOX], at(each)) for each in headers], factory


def test_objects_get_their_numbers_and_those_not_sure_of_none() -> None:
    tracks = CameraTracks(Factory())
    assert numbers(tracks.follow([BOX, BOX, BOX], at(header()))) == [1, 2, None]


def test_frames_that_go_on_belong_to_one_tracker() -> None:
    seen, factory = followed(header(seq=3), header(seq=4), header(seq=9))
    assert [tracker.frames for tracker in factory.made] == [3]
    assert len({epoch(objects) for objects in seen}) == 1


def test_another_source_an_older_frame_or_a_long_gap_begin_anew() -> None:
    first = header(seq=3)
    for other in (
        msgspec.structs.replace(first, boot_id="another", seq=4),
        msgspec.structs.replace(first, seq=3),
        msgspec.structs.replace(first, seq=4, received_ns=first.received_ns + GAP_NS + 1),
        msgspec.structs.replace(first, seq=4, received_ns=first.received_ns - 1),
    ):
        seen, factory = followed(first, other)
        assert [tracker.frames for tracker in factory.made] == [1, 1]
        assert epoch(seen[0]) != epoch(seen[1])


def test_a_gap_that_is_just_short_enough_goes_on() -> None:
    first = header(seq=3)
    _, factory = followed(first, msgspec.structs.replace(first, seq=4, received_ns=first.received_ns + GAP_NS))
    assert len(factory.made) == 1


def test_two_cameras_never_share_a_number() -> None:
    one, other = (CameraTracks(Factory()).follow([BOX], at(header()))[0].track for _ in range(2))
    assert one != other


@pytest.fixture
def factory() -> Factory:
    return Factory()


@pytest.fixture
def tracking(factory: Factory) -> Iterator[Tracking]:
    made = Tracking(factory, max_cameras=2)
    yield made
    made.close()


def request(robot: str, seq: int = 0) -> Request:
    return Request(CameraKey(robot, "front"), frame(seq), masks=False)


async def test_each_camera_has_its_own_tracker_and_it_is_said_how_long_that_took(
    factory: Factory, tracking: Tracking
) -> None:
    one, other = [await tracking.follow(request(robot), DetectedObjects([BOX], {"model": 7})) for robot in ("r1", "r2")]
    assert len(factory.made) == 2
    assert one.objects[0].track != other.objects[0].track
    assert set(one.spans) == {"model", "track"}
    assert one.spans["model"] == 7


async def test_frames_are_taken_in_the_order_of_the_calls(factory: Factory, tracking: Tracking) -> None:
    await asyncio.gather(*(tracking.follow(request("r1", seq), DetectedObjects([BOX])) for seq in range(20)))
    assert [tracker.frames for tracker in factory.made] == [20]


async def test_trackers_of_cameras_not_seen_for_longest_are_let_go(factory: Factory, tracking: Tracking) -> None:
    for robot in ("r1", "r2", "r1", "r3", "r1", "r2"):
        await tracking.follow(request(robot, len(factory.made)), DetectedObjects([BOX]))
    assert len(factory.made) == 4


class Failing(Counting):
    """Fails on its second frame."""

    def update(self, objects: Sequence[Detection], frame: ImageFrame) -> Sequence[int | None]:
        if self.frames == 1:
            raise RuntimeError("no way")
        return super().update(objects, frame)


async def test_what_cannot_be_followed_is_there_all_the_same_and_its_camera_begins_anew(
    caplog: pytest.LogCaptureFixture,
) -> None:
    tracking = Tracking(Failing)
    found = [await tracking.follow(request("r1", seq), DetectedObjects([BOX])) for seq in range(3)]
    assert [numbers(each.objects) for each in found] == [[1], [None], [1]]
    assert epoch(found[0].objects) != epoch(found[2].objects)
    assert "r1/front: objects of frame 1 are not followed" in caplog.text
    tracking.close()


async def test_what_was_closed_follows_nothing_more(tracking: Tracking) -> None:
    tracking.close()
    with pytest.raises(RuntimeError):
        await tracking.follow(request("r1"), DetectedObjects([BOX]))


def test_another_model_begins_the_tracks_of_a_camera_anew() -> None:
    factory = Factory()
    tracks = CameraTracks(factory)
    found = [
        tracks.follow([BOX], at(header(seq=seq)), model) for seq, model in enumerate(("a", "a", "b", "b", "a"), start=1)
    ]
    assert [each.frames for each in factory.made] == [2, 2, 1]
    assert len({epoch(each) for each in found}) == 3


async def test_the_model_that_found_objects_is_that_of_their_tracks() -> None:
    factory = Factory()
    tracking = Tracking(factory)
    for seq, model in enumerate(("a", "b"), start=1):
        await tracking.follow(request("r1", seq), DetectedObjects([BOX], model=model))
    tracking.close()
    assert [each.frames for each in factory.made] == [1, 1]
