from collections.abc import Sequence

import msgspec

from schemas.detections import TRACK_COUNT_BITS, Box, Detection
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from services.detector.model import Failed, Found, Request
from services.detector.tracking import GAP_NS, CameraTracks, TrackingModel
from tests.schemas.frames import header
from tests.services.detector.fakes import FakeModel
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


async def test_each_camera_has_its_own_tracker_and_failures_pass() -> None:
    factory = Factory()
    model = TrackingModel(FakeModel(), factory)
    batch = [
        Request(CameraKey("r1", "front"), frame(0), masks=False),
        Request(CameraKey("r1", "rear"), frame(0, color=FakeModel.FATAL), masks=False),
        Request(CameraKey("r2", "front"), frame(0), masks=False),
    ]
    front, failed, other = await model.infer(batch)
    assert isinstance(front, Found)
    assert isinstance(failed, Failed)
    assert isinstance(other, Found)
    assert len(factory.made) == 2
    assert front.objects[0].track != other.objects[0].track


async def test_trackers_of_cameras_not_seen_for_longest_are_let_go() -> None:
    factory = Factory()
    model = TrackingModel(FakeModel(), factory, max_cameras=2)
    for robot in ("r1", "r2", "r1", "r3", "r1", "r2"):
        await model.infer([Request(CameraKey(robot, "front"), frame(len(factory.made)), masks=False)])
    assert len(factory.made) == 4
