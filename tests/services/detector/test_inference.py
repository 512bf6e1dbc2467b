"""Batches of several cameras' frames through a model that is told when to answer."""

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager

import msgspec
import pytest

from bus import QUEUE, Bus, Subscription
from bus.fake import FakeNetwork
from bus.sharing import watchdog
from schemas import codec, keys
from schemas.detections import ClassList, Detection, Detections
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from services.detector.camera import CameraOutputs, serving
from services.detector.frame_counts import FAILED, LATE, MALFORMED, STALE, FrameCounts
from services.detector.frame_queue import FrameQueue, QueuedFrame
from services.detector.inference import NETWORK_GRACE_S, Inference
from services.detector.model import Failed, ModelError
from services.detector.regions import Regions
from services.detector.tracking.tracks import Tracking
from services.toolbox.logs import RateLimit, RateLimitFilter
from tests.schemas.frames import header, image
from tests.services.detector.support.told_model import FATAL, ToldModel
from tests.waiting import PATIENCE_S, next_of, until

CAMERAS = [CameraKey("r1", f"c{number}") for number in range(4)]


def frame(camera: CameraKey, seq: int) -> ImageFrame:
    return msgspec.structs.replace(image(), header=header(robot=camera.robot, camera=camera.camera, seq=seq))


class Rig:
    """Four cameras whose class lists are wanted, a frame_queue, and what takes frames from it."""

    def __init__(
        self,
        model: ToldModel,
        max_age_s: float | None = 3600,
        *,
        tracking: Tracking | None = None,
        keeps_up: bool = True,
        regions: Sequence[str] = (),
    ) -> None:
        self.model = model
        self.frame_queue = FrameQueue()
        self.cameras: dict[CameraKey, CameraOutputs] = {}
        self.tallies = {key: FrameCounts(key) for key in CAMERAS}
        self.told: list[CameraKey] = []
        self.inference = Inference(
            model,
            "w1",
            self.frame_queue,
            tracking=tracking,
            cameras=self.cameras,
            tallies=self.tallies,
            max_age_s=max_age_s,
            keeps_up=lambda: keeps_up,
            on_result=self.told.append,
            regions=Regions(regions),
        )

    @asynccontextmanager
    async def running(self, bus: Bus) -> AsyncIterator[Subscription]:
        async with AsyncExitStack() as stack:
            lists = await stack.enter_async_context(bus.subscribe(keys.every_stream(Stream.CLASSES), QUEUE(99)))
            for key in CAMERAS:
                self.cameras[key] = await stack.enter_async_context(serving(bus, key, self.tallies[key]))
            await until(lambda: all(camera.demand.wanted for camera in self.cameras.values()))
            async with asyncio.TaskGroup() as group:
                task = group.create_task(self.inference.run())
                yield lists
                task.cancel()

    def post(self, camera: CameraKey, seq: int, arrived_ns: int | None = None) -> None:
        self.frame_queue.post(camera, QueuedFrame(frame(camera, seq), arrived_ns or time.time_ns()))

    async def called(self, count: int) -> None:
        await until(lambda: len(self.model.calls) == count)


@pytest.fixture
async def bus() -> AsyncIterator[Bus]:
    async with FakeNetwork().open_bus() as made:
        yield made


async def result(lists: Subscription) -> tuple[str, int]:
    sample = await next_of(lists)
    found = codec.decode(ClassList, sample.payload, sample.encoding)
    return found.header.camera, found.header.seq


async def test_what_a_model_that_ended_still_had_is_not_waited_for(bus: Bus) -> None:
    rig = Rig(ToldModel())
    async with rig.running(bus):
        rig.post(CAMERAS[0], 1)
        await rig.called(1)
        waiting = asyncio.create_task(rig.inference.settled(CAMERAS[0]))
        await asyncio.sleep(0)
        assert not waiting.done()
    async with asyncio.timeout(PATIENCE_S):
        await waiting


async def test_newest_frames_of_different_cameras_are_one_call(bus: Bus) -> None:
    rig = Rig(ToldModel(max_batch=3))
    async with rig.running(bus) as lists:
        for camera in CAMERAS:
            rig.post(camera, 1)
            rig.post(camera, 2)
        await rig.called(1)
        assert [(each.camera, each.frame.header.seq, each.masks) for each in rig.model.calls[0]] == [
            (camera, 2, False) for camera in CAMERAS[:3]
        ]
        rig.model.answers[0].set()
        await rig.called(2)
        rig.model.answers[1].set()
        assert [await result(lists) for _ in CAMERAS] == [(camera.camera, 2) for camera in CAMERAS]
        assert rig.told == CAMERAS
        assert rig.inference.totals().done == 4


async def test_a_batch_does_not_wait_long_for_cameras_that_send_nothing(bus: Bus) -> None:
    rig = Rig(ToldModel(max_batch=4))
    async with rig.running(bus):
        rig.post(CAMERAS[0], 1)
        await rig.called(1)
        assert len(rig.model.calls[0]) == 1


async def test_as_many_calls_are_under_way_as_the_model_likes_and_results_keep_their_order(bus: Bus) -> None:
    rig = Rig(ToldModel(in_flight=2))
    async with rig.running(bus) as lists:
        for seq, camera in enumerate(CAMERAS):
            rig.post(camera, seq)
        await rig.called(2)
        await asyncio.sleep(0.02)
        assert len(rig.model.calls) == 2
        rig.model.answers[1].set()
        await asyncio.sleep(0.02)
        assert lists.counts.received == 0
        rig.model.answers[0].set()
        assert [await result(lists) for _ in range(2)] == [("c0", 0), ("c1", 1)]
        await rig.called(4)


async def test_a_frame_that_fails_fails_alone_and_is_named(bus: Bus, caplog: pytest.LogCaptureFixture) -> None:
    rig = Rig(ToldModel(max_batch=2))
    async with rig.running(bus) as lists:
        rig.post(CAMERAS[0], FATAL)
        rig.post(CAMERAS[1], 1)
        await rig.called(1)
        rig.model.answers[0].set()
        assert await result(lists) == ("c1", 1)
    assert rig.tallies[CAMERAS[0]].dropped == {FAILED: 1}
    assert (rig.tallies[CAMERAS[0]].done, rig.tallies[CAMERAS[1]].done) == (0, 1)
    assert "r1/c0: failed in the model, RuntimeError: frame 13 of gateway boot left out: fatal" in caplog.text


async def test_each_reason_that_a_cameras_frames_are_left_out_for_is_logged(
    bus: Bus, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(ToldModel(at_once=True))
    reasons = iter(
        [Failed(FAILED, RuntimeError("a")), Failed(FAILED, ValueError("b")), Failed(MALFORMED, ValueError("c"))]
    )
    monkeypatch.setattr(rig.model, "_look_at", lambda _: next(reasons))
    monkeypatch.setattr(caplog.handler, "filters", [RateLimitFilter(RateLimit())])
    async with rig.running(bus):
        for number in range(3):
            rig.post(CAMERAS[0], number)
            await until(lambda number=number: rig.inference.totals().done == number + 1)  # type: ignore[misc]
    assert [message.rpartition(": ")[2] for message in caplog.messages] == ["a", "b", "c"]


async def test_a_frame_that_is_too_old_when_its_turn_comes_is_left_out_and_counted(bus: Bus) -> None:
    rig = Rig(ToldModel(), max_age_s=60)
    async with rig.running(bus):
        rig.post(CAMERAS[0], 1, arrived_ns=1)
        await until(lambda: rig.tallies[CAMERAS[0]].dropped == {STALE: 1})
        assert not rig.model.calls
        assert rig.inference.totals().lost == 1


async def test_what_is_under_way_of_a_camera_can_be_waited_for(bus: Bus) -> None:
    rig = Rig(ToldModel())
    async with rig.running(bus) as lists:
        await rig.inference.settled(CAMERAS[0])
        rig.post(CAMERAS[0], 1)
        await rig.called(1)
        settled = asyncio.create_task(rig.inference.settled(CAMERAS[0]))
        await asyncio.sleep(0)
        assert not settled.done()
        rig.model.answers[0].set()
        await settled
        assert await result(lists) == ("c0", 1)


class HeldUp:
    """A tracker that takes as long as it is told to."""

    def __init__(self) -> None:
        self.may_go_on = threading.Event()
        self.frames: list[int] = []

    def update(self, objects: Sequence[Detection], frame: ImageFrame) -> Sequence[int | None]:
        self.may_go_on.wait(10)
        self.frames.append(frame.header.seq)
        return [None for _ in objects]


@asynccontextmanager
async def held_up(bus: Bus, camera: CameraKey) -> AsyncIterator[tuple[Rig, HeldUp, Subscription, Subscription]]:
    """Follow a camera's objects with a tracker that is held up; yield class lists and that camera's detections too."""
    tracker = HeldUp()
    tracking = Tracking(lambda: tracker)
    rig = Rig(ToldModel(at_once=True), tracking=tracking)
    async with (
        rig.running(bus) as lists,
        bus.subscribe(camera.stream(Stream.DETECTIONS), QUEUE(9)) as detections,
    ):
        await until(lambda: rig.cameras[camera].wants_tracks)
        yield rig, tracker, lists, detections
    tracking.close()


async def test_lists_of_classes_do_not_wait_for_tracks_and_nobody_elses_objects_are_followed(bus: Bus) -> None:
    async with held_up(bus, CAMERAS[1]) as (rig, tracker, lists, detections):
        for seq, camera in enumerate(CAMERAS[:2]):
            rig.post(camera, seq)
        assert [await result(lists) for _ in range(2)] == [("c0", 0), ("c1", 1)]
        assert detections.counts.received == 0
        tracker.may_go_on.set()
        sample = await next_of(detections)
        found = codec.decode(Detections, sample.payload, sample.encoding)
        assert (found.header.seq, set(found.spans)) == (1, {"queue", "model", "track"})
        assert tracker.frames == [1]
        assert rig.told == CAMERAS[:2]


async def test_frames_wait_for_tracks_before_they_go_to_the_model_and_not_after(bus: Bus) -> None:
    async with held_up(bus, CAMERAS[0]) as (rig, tracker, lists, _):
        for seq in range(9):
            rig.post(CAMERAS[0], seq)
            await asyncio.sleep(0.01)
        assert len(rig.model.calls) <= 4
        tracker.may_go_on.set()
        while await result(lists) != ("c0", 8):
            pass


async def test_a_worker_whose_frames_wait_for_tracks_has_no_time_left(bus: Bus) -> None:
    async with held_up(bus, CAMERAS[0]) as (rig, tracker, lists, _):
        for seq in range(3):
            rig.post(CAMERAS[0], seq)
            assert await result(lists) == ("c0", seq)
        before_s = rig.inference.totals().busy_s
        await asyncio.sleep(0.1)
        assert rig.inference.totals().busy_s - before_s > 0.09
        tracker.may_go_on.set()
        await until(lambda: len(tracker.frames) == 3)
        idle_s = rig.inference.totals().busy_s
        await asyncio.sleep(0.02)
        assert rig.inference.totals().busy_s == idle_s


async def test_a_model_that_is_of_no_more_use_ends_it(bus: Bus) -> None:
    rig = Rig(ToldModel())
    rig.model.broken = True

    async def break_it() -> None:
        async with rig.running(bus):
            rig.post(CAMERAS[0], 1)
            await rig.called(1)
            rig.model.answers[0].set()
            await asyncio.Event().wait()

    with pytest.raises(ExceptionGroup) as caught:
        await break_it()
    assert caught.group_contains(ModelError)


async def test_a_model_that_never_answers_ends_it(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "CHECK_S", 0.005)
    rig = Rig(ToldModel())

    async def wait_for_it() -> None:
        async with rig.running(bus) as lists:
            await asyncio.sleep(0.5)
            rig.post(CAMERAS[0], 1)
            await rig.called(1)
            rig.model.answers[0].set()
            assert await result(lists) == ("c0", 1), "one that is asked nothing need not answer"
            rig.post(CAMERAS[0], 2)
            await asyncio.Event().wait()

    with pytest.raises(ExceptionGroup) as caught:
        async with asyncio.timeout(60):
            await wait_for_it()
    assert caught.group_contains(ModelError, match="told has not answered for 0.3 s")


@pytest.mark.parametrize(
    ("late_s", "keeps_up", "max_age_s", "used"),
    [
        (0.07, False, None, True),
        (0.1, False, None, False),
        (0.1, True, None, True),
        (0.99 * NETWORK_GRACE_S, True, None, True),
        (NETWORK_GRACE_S + 0.1, True, None, False),
        (0.02, True, 0.01, False),
        (NETWORK_GRACE_S + 0.1, True, 3600, True),
    ],
)
async def test_frames_of_a_poor_link_are_used_while_there_is_time_for_them(
    bus: Bus, *, late_s: float, keeps_up: bool, max_age_s: float | None, used: bool
) -> None:
    rig = Rig(ToldModel(), max_age_s, keeps_up=keeps_up)
    async with rig.running(bus):
        now_ns = time.time_ns() + 3_600_000_000_000  # it waits for nothing, however slow this machine is
        rig.frame_queue.post(CAMERAS[0], QueuedFrame(frame(CAMERAS[0], 1), now_ns, round(late_s * 1e9)))
        await until(lambda: bool(rig.model.calls or rig.tallies[CAMERAS[0]].dropped))
        assert (len(rig.model.calls), rig.tallies[CAMERAS[0]].dropped) == ((1, {}) if used else (0, {LATE: 1}))
        assert rig.inference.totals().lost == 0
