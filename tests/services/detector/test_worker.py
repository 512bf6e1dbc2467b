import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import msgspec
import numpy as np
import pytest
from backports import zstd

from bus import QUEUE, Bus, Publisher, QoS, Subscription
from bus.clocks import clock_id
from bus.fake import FakeNetwork
from bus.reporting import VERSION
from schemas import codec, consumer_keys, keys, worker_keys
from schemas.consumer_keys import Wanted
from schemas.detections import ClassCount, ClassList, Detections
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream, StreamKey
from schemas.status import UNWANTED, CameraLoad, WorkerStatus
from schemas.worker_keys import WorkerAlive
from services.detector.frame_counts import DEPTH, FAILED, MALFORMED, REPLACED
from services.detector.process import DetectorWorker
from tests.schemas.frames import header
from tests.schemas.pictures import compressed, file_of
from tests.services.detector.support.fakes import FakeModel
from tests.waiting import PATIENCE_S, receive, until

ME = WorkerAlive("detector", "w1")
FRONT, REAR = CameraKey("r1", "front"), CameraKey("r1", "rear")


def frame(seq: int, camera: CameraKey = FRONT, color: tuple[int, int, int] = (9, 8, 7)) -> ImageFrame:
    pixels = np.full((4, 6, 3), color, np.uint8)
    about = header(robot=camera.robot, camera=camera.camera, seq=seq)
    return ImageFrame(header=about, height=4, width=6, encoding="bgr8", step=18, data=memoryview(pixels.tobytes()))


class Rig:
    """A worker on a fake bus, and the rest of the fleet as seen by a test."""

    def __init__(self, bus: Bus, model: FakeModel) -> None:
        self.bus = bus
        self.model = model

    @asynccontextmanager
    async def camera(self, key: CameraKey) -> AsyncIterator[Publisher]:
        async with (
            self.bus.publisher(key.stream(Stream.COLOR), QoS.IMAGE, encoding=codec.encoding(ImageFrame)) as publisher,
            self.bus.announce(key.alive(Stream.COLOR)),
        ):
            yield publisher

    async def model_called(self) -> None:
        """Wait until a frame is with the model, which has been waited for as often as this was called before."""
        assert await asyncio.to_thread(self.model.called.acquire, timeout=PATIENCE_S)


async def loads_after(statuses: Subscription, *, inferred: int) -> dict[str, CameraLoad]:
    """Wait for the status that says so many frames were inferred; return its tallies by camera."""
    while True:
        status = await receive(statuses, WorkerStatus)
        if sum(load.inferred for load in status.cameras) >= inferred:
            assert status.busy_s
            return {load.camera: load for load in status.cameras}


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    network, model = FakeNetwork(), FakeModel()
    async with network.open_bus() as theirs, network.open_bus() as ours, asyncio.TaskGroup() as group:
        working = group.create_task(DetectorWorker(ours, model, [ME], max_age_s=60, join_s=0).run())
        yield Rig(theirs, model)
        model.may_answer.set()
        working.cancel()


async def test_nobody_listens_so_nothing_is_asked_of_the_camera_or_the_model(rig: Rig) -> None:
    async with rig.camera(FRONT) as camera:
        await asyncio.sleep(0.05)
        camera.put(codec.encode(frame(0)))
        await asyncio.sleep(0.05)
        assert not camera.wanted
        assert not rig.model.seen


async def test_a_listener_to_classes_makes_the_worker_infer_and_leaving_ends_it(rig: Rig) -> None:
    async with rig.camera(FRONT) as camera:
        async with rig.bus.subscribe(keys.every_stream(Stream.CLASSES), QUEUE(9)) as classes:
            await until(lambda: camera.wanted)
            camera.put(codec.encode(frame(5)))
            seen = await receive(classes, ClassList)
            assert seen.classes == [ClassCount("box", 1, 0.75)]
            assert (seen.header, seen.model, seen.worker) == (frame(5).header, "fake", "w1")
            assert set(seen.spans) == {"queue", "model"}
        await until(lambda: not camera.wanted)


async def test_one_model_call_serves_every_output(rig: Rig) -> None:
    async with (
        rig.camera(FRONT) as camera,
        rig.bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)) as classes,
        rig.bus.subscribe(FRONT.stream(Stream.DETECTIONS), QUEUE(9)) as detections,
    ):
        await until(lambda: camera.wanted)
        camera.put(codec.encode(frame(0)))
        found = await receive(detections, Detections)
        assert (await receive(classes, ClassList)).header == found.header
        (box,) = found.objects
        assert box.mask is not None
        assert box.mask.size == (4, 6)
        assert len(rig.model.seen) == 1


async def test_pixels_reach_the_model_as_they_were(rig: Rig) -> None:
    async with rig.camera(FRONT) as camera, rig.bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)) as classes:
        await until(lambda: camera.wanted)
        camera.put(codec.encode(frame(0, color=(1, 2, 3))))
        await receive(classes, ClassList)
        assert tuple(rig.model.seen[0][3, 5]) == (1, 2, 3)


async def test_while_the_model_works_the_newest_frame_replaces_the_waiting_one(rig: Rig) -> None:
    status_key = worker_keys.worker_status("detector", "w1")
    async with (
        rig.camera(FRONT) as camera,
        rig.bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)) as classes,
        rig.bus.subscribe(status_key, QUEUE(9)) as statuses,
    ):
        await until(lambda: camera.wanted)
        rig.model.may_answer.clear()
        camera.put(codec.encode(frame(0)))
        await rig.model_called()
        for seq in (1, 2, 3):
            camera.put(codec.encode(frame(seq)))
            await asyncio.sleep(0.01)
        rig.model.may_answer.set()
        assert [(await receive(classes, ClassList)).header.seq for _ in range(2)] == [0, 3]
        assert (await loads_after(statuses, inferred=2))["front"].dropped == {REPLACED: 2}


async def test_a_bad_frame_is_counted_and_harms_no_other(rig: Rig) -> None:
    other = msgspec.structs.replace(frame(1), header=header(robot="r9"))
    async with (
        rig.camera(FRONT) as front,
        rig.camera(REAR) as rear,
        rig.bus.subscribe(keys.every_stream(Stream.CLASSES), QUEUE(9)) as classes,
        rig.bus.subscribe(worker_keys.worker_status("detector", "w1"), QUEUE(9)) as statuses,
    ):
        await until(lambda: front.wanted and rear.wanted)
        for bad in (b"garbage", codec.encode(other), codec.encode(frame(2, color=FakeModel.FATAL))):
            front.put(bad)
            await asyncio.sleep(0.02)
        await rig.model_called()
        front.put(codec.encode(frame(3)))
        assert (await receive(classes, ClassList)).header.seq == 3
        rear.put(codec.encode(frame(0, REAR)))
        assert (await receive(classes, ClassList)).header.camera == "rear"
        loads = await loads_after(statuses, inferred=2)
        assert loads["front"].dropped == {MALFORMED: 2, FAILED: 1}
        assert loads["rear"].dropped == {}


async def test_frames_that_jump_from_number_to_number_end_neither_the_worker_nor_its_statuses(rig: Rig) -> None:
    numbers = [0, 2**63 - 1] * 4
    async with (
        rig.camera(FRONT) as camera,
        rig.bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)) as classes,
        rig.bus.subscribe(worker_keys.worker_status("detector", "w1"), QUEUE(9)) as statuses,
    ):
        await until(lambda: camera.wanted)
        for number in numbers:
            about = msgspec.structs.replace(header(), seq=number)
            camera.put(codec.encode(msgspec.structs.replace(frame(0), header=about)))
            assert (await receive(classes, ClassList)).header.seq == number
        assert (await loads_after(statuses, inferred=len(numbers)))["front"].dropped == {}


async def test_a_depth_image_is_refused_for_what_it_is(rig: Rig) -> None:
    async with (
        rig.camera(FRONT) as camera,
        rig.bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)) as classes,
        rig.bus.subscribe(worker_keys.worker_status("detector", "w1"), QUEUE(9)) as statuses,
    ):
        await until(lambda: camera.wanted)
        for seq, encoding in enumerate(("16UC1", "32FC1")):
            camera.put(codec.encode(msgspec.structs.replace(frame(seq), width=4, encoding=encoding)))
            await asyncio.sleep(0.02)
        camera.put(codec.encode(frame(2)))
        assert (await receive(classes, ClassList)).header.seq == 2
        assert (await loads_after(statuses, inferred=1))["front"].dropped == {DEPTH: 2}
    assert len(rig.model.seen) == 1


async def test_a_compressed_picture_is_decoded_and_a_damaged_one_is_malformed(rig: Rig) -> None:
    file = file_of(np.full((4, 6, 3), (1, 2, 3), np.uint8), ".png")
    async with (
        rig.camera(FRONT) as camera,
        rig.bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)) as classes,
        rig.bus.subscribe(worker_keys.worker_status("detector", "w1"), QUEUE(9)) as statuses,
    ):
        await until(lambda: camera.wanted)
        camera.put(codec.encode(compressed(file[:40], "rgb8", 18)))
        await rig.model_called()
        camera.put(codec.encode(msgspec.structs.replace(compressed(file, "rgb8", 18), header=header(seq=1))))
        await receive(classes, ClassList)
        assert (await loads_after(statuses, inferred=1))["front"].dropped == {MALFORMED: 1}
    assert [tuple(image[3, 5]) for image in rig.model.seen] == [(1, 2, 3)]


async def test_a_camera_that_leaves_and_returns_is_served_again(rig: Rig) -> None:
    async with rig.bus.subscribe(keys.every_stream(Stream.CLASSES), QUEUE(9)) as classes:
        for seq in (0, 1):
            async with rig.camera(FRONT) as camera:
                await until(lambda camera=camera: camera.wanted)  # type: ignore[misc]
                camera.put(codec.encode(frame(seq)))
                assert (await receive(classes, ClassList)).header.seq == seq


async def test_a_camera_that_blinks_is_served_by_one_task_only(rig: Rig) -> None:
    async with (
        rig.bus.publisher(FRONT.stream(Stream.COLOR), QoS.IMAGE, encoding=codec.encoding(ImageFrame)) as camera,
        rig.bus.subscribe(keys.every_stream(Stream.CLASSES), QUEUE(9)) as classes,
    ):
        for seq in range(4):
            async with rig.bus.announce(FRONT.alive(Stream.COLOR)):
                await asyncio.sleep(0)
                await asyncio.sleep(0)
            await asyncio.sleep(0)
            async with rig.bus.announce(FRONT.alive(Stream.COLOR)):
                await asyncio.sleep(0.01)
                await until(lambda: camera.wanted)
                camera.put(codec.encode(frame(seq)))
                assert (await receive(classes, ClassList)).header.seq == seq


async def test_a_camera_that_blinks_twice_before_anybody_has_left_is_served_again(rig: Rig) -> None:
    async with (
        rig.bus.publisher(FRONT.stream(Stream.COLOR), QoS.IMAGE, encoding=codec.encoding(ImageFrame)) as camera,
        rig.bus.subscribe(keys.every_stream(Stream.CLASSES), QUEUE(9)) as classes,
    ):
        for _ in range(3):
            async with rig.bus.announce(FRONT.alive(Stream.COLOR)):
                await asyncio.sleep(0)
            await asyncio.sleep(0)
        async with rig.bus.announce(FRONT.alive(Stream.COLOR)):
            await asyncio.sleep(0.05)
            await until(lambda: camera.wanted)
            camera.put(codec.encode(frame(7)))
            assert (await receive(classes, ClassList)).header.seq == 7
        await until(lambda: not camera.wanted)


async def test_a_frame_that_waits_when_the_demand_ends_is_counted(rig: Rig) -> None:
    async with (
        rig.camera(FRONT) as camera,
        rig.bus.subscribe(worker_keys.worker_status("detector", "w1"), QUEUE(99)) as statuses,
    ):
        async with rig.bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)):
            await until(lambda: camera.wanted)
            rig.model.may_answer.clear()
            camera.put(codec.encode(frame(0)))
            await rig.model_called()
            camera.put(codec.encode(frame(1)))
            await asyncio.sleep(0.05)
        await until(lambda: not camera.wanted)
        rig.model.may_answer.set()
        load = (await loads_after(statuses, inferred=1))["front"]
        assert (load.inferred, load.dropped) == (1, {UNWANTED: 1})


async def test_a_key_that_is_no_camera_is_left_out(rig: Rig) -> None:
    async with (
        rig.bus.announce("fleet/r1/status/color/alive"),
        rig.camera(FRONT) as camera,
        rig.bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)),
    ):
        await until(lambda: camera.wanted)


async def test_the_worker_is_present_and_says_goodbye(rig: Rig) -> None:
    async with rig.bus.watch("workers/*/*/*/*/alive") as watch:
        presence = await anext(watch)
        assert (worker_keys.parse_worker(presence.key), presence.alive) == (("detector", "w1"), True)


async def test_it_says_its_version(rig: Rig) -> None:
    async with rig.bus.subscribe(worker_keys.worker_status("detector", "w1"), QUEUE(9)) as statuses:
        status = await receive(statuses, WorkerStatus)
        assert (status.version, status.runtime) == (VERSION, "fake")


async def test_it_says_where_a_cameras_frames_go_while_it_wants_them(rig: Rig) -> None:
    async with (
        rig.camera(FRONT) as camera,
        rig.bus.watch(consumer_keys.every_wanted("r1")) as watch,
        asyncio.timeout(PATIENCE_S),
    ):
        async with rig.bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)):
            token = await anext(watch)
            assert consumer_keys.parse_wanted(token.key) == Wanted(StreamKey(FRONT, Stream.COLOR), clock_id(), "w1")
            await until(lambda: camera.wanted)
        assert (await anext(watch)).alive is False


async def test_zstd_data_is_inferred_from_and_damaged_data_is_malformed(rig: Rig) -> None:
    raw = frame(1, color=(1, 2, 3))
    data = zstd.compress(raw.data)
    async with (
        rig.camera(FRONT) as camera,
        rig.bus.subscribe(FRONT.stream(Stream.CLASSES), QUEUE(9)) as classes,
        rig.bus.subscribe(worker_keys.worker_status("detector", "w1"), QUEUE(9)) as statuses,
    ):
        await until(lambda: camera.wanted)
        for seq, sent in enumerate((data[:-1], data)):
            about = header(seq=seq)
            camera.put(codec.encode(msgspec.structs.replace(raw, header=about, format="zstd", data=memoryview(sent))))
            await rig.model_called()
        await receive(classes, ClassList)
        assert (await loads_after(statuses, inferred=1))["front"].dropped == {MALFORMED: 1}
    assert [tuple(image[3, 5]) for image in rig.model.seen] == [(1, 2, 3)]
