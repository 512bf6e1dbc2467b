"""A cloud worker on a fake bus, and the rest of the fleet as seen by a test."""

import asyncio
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack
from typing import Any

import msgspec
import numpy as np
import pytest

from bus import QUEUE, Bus, Publisher, QoS
from bus.clocks import clock_id
from bus.fake import FakeNetwork
from bus.reporting import VERSION
from schemas import codec, consumer_keys, keys, worker_keys
from schemas.camera_info import CameraInfo
from schemas.consumer_keys import Wanted
from schemas.detections import Detections
from schemas.header import Header
from schemas.keys import CameraKey, RobotStreamKey, Stream, StreamKey
from schemas.objects import ObjectClouds
from schemas.points import PointCloud
from schemas.status import CameraLoad, WorkerStatus
from schemas.transforms import Transform, Transforms
from services.cloud.process import SERVICE, CloudWorker
from services.cloud.settings import CloudSettings
from services.cloud.waiting import MALFORMED, MALFORMED_POINTS, UNJOINED, UNPLACED
from tests.schemas.frames import header
from tests.services.cloud.clouds import xyz_cloud
from tests.services.cloud.scenes import Cuboid, camera_view, detection, detections, lidar_view
from tests.services.geometry.cameras import info
from tests.waiting import receive, until

FRONT, LIDAR = CameraKey("r1", "front"), CameraKey("r1", "lidar")
BOXES = (Cuboid((4.0, 0.6), (0.6, 0.9, 0.7)),)
SCHEMAS: dict[str, type[Any]] = {
    Stream.DETECTIONS: Detections,
    Stream.POINTS: PointCloud,
    Stream.INFO: CameraInfo,
    keys.TF: Transforms,
    keys.TF_STATIC: Transforms,
}
OPTICAL, LENS = "camera_color_optical_frame", "lidar"
STAMP_NS = header().stamp_ns
PERIOD_NS = 33_000_000


def about(seq: int, camera: str = "front", frame_id: str = OPTICAL, stamp_ns: int | None = None) -> Header:
    stamp_ns = STAMP_NS + seq * PERIOD_NS if stamp_ns is None else stamp_ns
    return msgspec.structs.replace(header(seq=seq, camera=camera), stamp_ns=stamp_ns, frame_id=frame_id)


def found(seq: int) -> Detections:
    _, owners = camera_view(BOXES)
    return msgspec.structs.replace(detections(detection(owners == 1)), header=about(seq))


def registered(seq: int) -> PointCloud:
    points, _ = camera_view(BOXES)
    return xyz_cloud(points, np.full(points.shape, 9, np.uint8), header=about(seq))


def placed(parent: str, child: str, *, z: float = 0.0, optical: bool = False, robot: str = "r1") -> Transforms:
    rotation = (-0.5, 0.5, -0.5, 0.5) if optical else (0.0, 0.0, 0.0, 1.0)
    moved = Transform(frame_id=parent, child_frame_id=child, stamp_ns=0, translation=(0.0, 0.0, z), rotation=rotation)
    whole = msgspec.structs.replace(header(robot=robot, camera=""), stamp_ns=0)
    return Transforms(header=whole, transforms=[moved])


class Rig:
    """What sensors and detectors publish. Publishers are declared, and present, from their first use."""

    def __init__(self, bus: Bus, stack: AsyncExitStack) -> None:
        self.bus = bus
        self._stack = stack

    async def camera(self, camera: CameraKey, *streams: Stream) -> dict[Stream, Publisher]:
        made = {}
        for stream in streams:
            made[stream] = await self.publisher(camera.stream(stream), stream)
            if stream in {Stream.COLOR, Stream.POINTS}:
                await self._stack.enter_async_context(self.bus.announce(camera.alive(stream)))
        return made

    async def publisher(self, key: str, stream: str) -> Publisher:
        qos = QoS.IMAGE if stream in {Stream.COLOR, Stream.POINTS} else QoS.RESULT
        encoding = codec.encoding(SCHEMAS[stream]) if stream in SCHEMAS else "none"
        return await self._stack.enter_async_context(self.bus.publisher(key, qos, encoding=encoding))

    async def transforms(self, sent: Transforms) -> None:
        key = str(RobotStreamKey("r1", keys.TF_STATIC))
        (await self.publisher(key, keys.TF_STATIC)).put(codec.encode(sent))


async def load_when(rig: Rig, such: Callable[[CameraLoad], bool]) -> CameraLoad:
    async with rig.bus.subscribe(worker_keys.worker_status(SERVICE, "w1"), QUEUE(9)) as statuses:
        while True:
            for load in (await receive(statuses, WorkerStatus)).cameras:
                if such(load):
                    return load


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    network, settings = FakeNetwork(), CloudSettings(worker="w1")
    async with AsyncExitStack() as stack:
        executor = stack.enter_context(ThreadPoolExecutor(1))
        theirs = await stack.enter_async_context(network.open_bus())
        ours = await stack.enter_async_context(network.open_bus("rack1"))
        group = await stack.enter_async_context(asyncio.TaskGroup())
        worker = CloudWorker(ours, settings, executor, join_s=0)
        working = group.create_task(worker.run())
        yield Rig(theirs, await stack.enter_async_context(AsyncExitStack()))
        working.cancel()


async def test_it_says_its_version(rig: Rig) -> None:
    async with rig.bus.subscribe(worker_keys.worker_status(SERVICE, "w1"), QUEUE(9)) as statuses:
        assert (await receive(statuses, WorkerStatus)).version == VERSION


async def test_it_says_how_long_it_was_at_work(rig: Rig) -> None:
    front = await rig.camera(FRONT, Stream.COLOR, Stream.POINTS, Stream.DETECTIONS)
    async with rig.bus.subscribe(worker_keys.worker_status(SERVICE, "w1"), QUEUE(9)) as statuses:
        assert (await receive(statuses, WorkerStatus)).busy_s == 0
        async with rig.bus.subscribe(FRONT.stream(Stream.OBJECTS), QUEUE(9)) as objects:
            await until(lambda: front[Stream.POINTS].wanted and front[Stream.DETECTIONS].wanted)
            front[Stream.POINTS].put(codec.encode(registered(3)))
            front[Stream.DETECTIONS].put(codec.encode(found(3)))
            await receive(objects, ObjectClouds)
        while not (await receive(statuses, WorkerStatus)).busy_s:
            pass


async def test_nobody_wants_objects_so_nothing_is_asked_of_detector_or_gateway(rig: Rig) -> None:
    front = await rig.camera(FRONT, Stream.COLOR, Stream.POINTS, Stream.DETECTIONS)
    await asyncio.sleep(0.1)
    assert not any(publisher.wanted for publisher in front.values())


async def test_registered_points_become_objects_while_somebody_wants_them(rig: Rig) -> None:
    front = await rig.camera(FRONT, Stream.COLOR, Stream.POINTS, Stream.DETECTIONS)
    await rig.transforms(placed("base_link", OPTICAL, z=1.5, optical=True))
    async with rig.bus.watch(consumer_keys.every_wanted("r1")) as tokens:
        async with rig.bus.subscribe(FRONT.stream(Stream.OBJECTS), QUEUE(9)) as objects:
            await until(lambda: front[Stream.POINTS].wanted and front[Stream.DETECTIONS].wanted)
            assert not front[Stream.COLOR].wanted
            points, moving = sorted([consumer_keys.parse_wanted((await anext(tokens)).key) for _ in range(2)], key=str)
            assert points == Wanted(StreamKey(FRONT, Stream.POINTS), clock_id(), "w1")
            assert (moving.key, moving.clock_id) == (RobotStreamKey("r1", "tf"), clock_id())
            assert moving.consumer.startswith("rack1-")
            front[Stream.POINTS].put(codec.encode(registered(3)))
            front[Stream.DETECTIONS].put(codec.encode(found(3)))
            made = await receive(objects, ObjectClouds)
        await until(lambda: not any(publisher.wanted for publisher in front.values()))
    assert (made.header, made.worker, made.unmeasured) == (about(3), "w1", {})
    (box,) = made.objects
    assert box.in_target is not None
    assert box.in_target.box.centre == pytest.approx((4.0, 0.6, 0.35), abs=0.05)
    assert made.spans.keys() >= {"join", "cloud"}


async def test_detections_wait_for_the_points_of_their_instant(rig: Rig) -> None:
    front = await rig.camera(FRONT, Stream.COLOR, Stream.POINTS, Stream.DETECTIONS)
    async with rig.bus.subscribe(FRONT.stream(Stream.OBJECTS), QUEUE(9)) as objects:
        await until(lambda: front[Stream.POINTS].wanted and front[Stream.DETECTIONS].wanted)
        front[Stream.POINTS].put(codec.encode(registered(2)))
        front[Stream.DETECTIONS].put(codec.encode(found(3)))
        await asyncio.sleep(0.05)
        front[Stream.POINTS].put(codec.encode(registered(3)))
        made = await receive(objects, ObjectClouds)
    assert (made.header.seq, made.header.stamp_ns, len(made.objects)) == (3, about(3).stamp_ns, 1)
    assert (made.target, made.objects[0].in_target) == (None, None)
    assert "base_link" in made.unknown_target


async def test_a_lidars_points_are_those_of_the_robots_camera_through_tf_and_info(rig: Rig) -> None:
    front = await rig.camera(FRONT, Stream.COLOR, Stream.INFO, Stream.DETECTIONS)
    lidar = await rig.camera(LIDAR, Stream.POINTS)
    origin = np.array([0.0, 0.0, 1.9])
    points, _ = lidar_view(BOXES, origin)
    both = placed("base_link", OPTICAL, z=1.5, optical=True)
    both = msgspec.structs.replace(both, transforms=[*both.transforms, *placed("base_link", LENS, z=1.9).transforms])
    await rig.transforms(both)
    front[Stream.INFO].put(codec.encode(info(height=480, width=640, focal=480.0)))
    async with rig.bus.subscribe(FRONT.stream(Stream.OBJECTS), QUEUE(9)) as objects:
        await until(lambda: lidar[Stream.POINTS].wanted and front[Stream.DETECTIONS].wanted)
        turned = about(0, "lidar", LENS, stamp_ns=about(3).stamp_ns + 10_000_000)
        lidar[Stream.POINTS].put(codec.encode(xyz_cloud(points[None], header=turned)))
        front[Stream.DETECTIONS].put(codec.encode(found(3)))
        made = await receive(objects, ObjectClouds)
    assert (made.header.camera, made.header.frame_id, made.header.stamp_ns) == ("front", LENS, turned.stamp_ns)
    (box,) = made.objects
    assert box.in_target is not None
    assert box.in_target.box.centre[:2] == pytest.approx((4.0, 0.6), abs=0.12)


async def test_what_cannot_be_known_is_said_and_counted(rig: Rig) -> None:
    front = await rig.camera(FRONT, Stream.COLOR, Stream.POINTS, Stream.DETECTIONS)
    async with rig.bus.subscribe(FRONT.stream(Stream.OBJECTS), QUEUE(9)) as objects:
        await until(lambda: front[Stream.POINTS].wanted and front[Stream.DETECTIONS].wanted)
        front[Stream.DETECTIONS].put(codec.encode(found(1)))
        unjoined = await receive(objects, ObjectClouds)
        assert unjoined.unmeasured == {0: "no points arrived"}
        strange = msgspec.structs.replace(registered(2), header=about(2, frame_id="elsewhere"))
        front[Stream.POINTS].put(codec.encode(strange))
        front[Stream.DETECTIONS].put(codec.encode(found(2)))
        unplaced = await receive(objects, ObjectClouds)
        assert "points cannot be projected into the image: nothing is known of frame" in unplaced.unmeasured[0]
        whole = codec.encode(registered(3))
        for bad in (b"garbage", codec.encode(msgspec.structs.replace(registered(3), header=header(robot="r9")))):
            front[Stream.POINTS].put(bad)
            front[Stream.DETECTIONS].put(b"garbage")
            await asyncio.sleep(0.02)
        front[Stream.POINTS].put(whole)
        front[Stream.DETECTIONS].put(codec.encode(found(3)))
        assert len((await receive(objects, ObjectClouds)).objects) == 1
    load = await load_when(rig, lambda load: load.inferred == 1)
    assert load.dropped == {UNJOINED: 1, UNPLACED: 1, MALFORMED_POINTS: 2, MALFORMED: 2}
    assert load.serving


async def test_points_that_come_and_go_are_followed(rig: Rig) -> None:
    front = await rig.camera(FRONT, Stream.COLOR, Stream.DETECTIONS)
    async with rig.bus.subscribe(FRONT.stream(Stream.OBJECTS), QUEUE(9)):
        await asyncio.sleep(0.05)
        assert not front[Stream.DETECTIONS].wanted
        lidar = await rig.camera(LIDAR, Stream.POINTS)
        await until(lambda: lidar[Stream.POINTS].wanted and front[Stream.DETECTIONS].wanted)
        own = await rig.camera(FRONT, Stream.POINTS)
        await until(lambda: own[Stream.POINTS].wanted and not lidar[Stream.POINTS].wanted)
