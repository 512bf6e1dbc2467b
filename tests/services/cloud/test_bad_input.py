"""What sensors and clocks should never do, at a cloud worker: each costs its own frame and is counted or said."""

import asyncio
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack, asynccontextmanager

import msgspec

from bus import QUEUE, Publisher, Subscription
from bus.fake import FakeNetwork
from schemas import codec
from schemas.detections import Detections
from schemas.keys import CameraKey, Stream
from schemas.objects import ObjectClouds
from schemas.points import PointCloud
from services.cloud.process import CloudWorker
from services.cloud.settings import CloudSettings
from services.cloud.waiting import MALFORMED_POINTS
from services.geometry.memory_budget import CROWDED
from services.worker.stamp_joiner import FLUSHED
from tests.services.cloud.test_worker import FRONT, OPTICAL, Rig, about, found, load_when, placed, registered
from tests.waiting import receive, until

HOUR_NS = 3_600 * 10**9
STREAMS = (Stream.COLOR, Stream.POINTS, Stream.DETECTIONS)


@asynccontextmanager
async def working(**settings: object) -> AsyncIterator[Rig]:
    """Run a worker called w1, and have a rig for what it is sent."""
    network, made = FakeNetwork(), CloudSettings.model_validate({"worker": "w1", **settings})
    async with AsyncExitStack() as stack:
        executor = stack.enter_context(ThreadPoolExecutor(1))
        theirs = await stack.enter_async_context(network.open_bus())
        ours = await stack.enter_async_context(network.open_bus())
        group = await stack.enter_async_context(asyncio.TaskGroup())
        running = group.create_task(CloudWorker(ours, made, executor, join_s=0).run())
        yield Rig(theirs, await stack.enter_async_context(AsyncExitStack()))
        running.cancel()


class Camera:
    """The front camera, and the objects that come of what it sends."""

    def __init__(self, publishers: dict[Stream, Publisher], objects: Subscription) -> None:
        self._publishers = publishers
        self._objects = objects

    async def until_wanted(self) -> None:
        await until(lambda: all(self._publishers[each].wanted for each in (Stream.POINTS, Stream.DETECTIONS)))

    def send(self, points: PointCloud | bytes, seen: Detections) -> None:
        self._publishers[Stream.POINTS].put(points if isinstance(points, bytes) else codec.encode(points))
        self._publishers[Stream.DETECTIONS].put(codec.encode(seen))

    async def cut(self, points: PointCloud | bytes, seen: Detections) -> ObjectClouds:
        """Return what is made of detections and points that came together."""
        self.send(points, seen)
        return await receive(self._objects, ObjectClouds)


@asynccontextmanager
async def wanted(rig: Rig) -> AsyncIterator[Camera]:
    publishers = await rig.camera(FRONT, *STREAMS)
    async with rig.bus.subscribe(FRONT.stream(Stream.OBJECTS), QUEUE(9)) as objects:
        camera = Camera(publishers, objects)
        await camera.until_wanted()
        yield camera


async def test_clouds_of_another_size_than_their_header_says_are_counted() -> None:
    said = msgspec.msgpack.decode(codec.encode(registered(1)))
    changes: tuple[dict[str, object], ...] = ({"height": 960}, {"width": 641}, {"row_step": 8}, {"data": b""})
    async with working() as rig, wanted(rig) as camera:
        for seq, changed in enumerate(changes, 1):
            made = await camera.cut(msgspec.msgpack.encode({**said, **changed}), found(seq))
            assert made.unmeasured == {0: "no points arrived"}
        assert len((await camera.cut(registered(9), found(9))).objects) == 1
        load = await load_when(rig, lambda load: load.inferred == 1)
    assert load.dropped[MALFORMED_POINTS] == len(changes)


async def test_points_from_the_future_are_joined_with_nothing_and_do_not_stay_in_the_way() -> None:
    ahead = registered(2)
    ahead = msgspec.structs.replace(
        ahead, header=msgspec.structs.replace(ahead.header, stamp_ns=ahead.header.stamp_ns + HOUR_NS)
    )
    async with working() as rig, wanted(rig) as camera:
        assert len((await camera.cut(registered(1), found(1))).objects) == 1
        made = await camera.cut(ahead, found(2))
        assert made.unmeasured[0].startswith("no points of its instant: the nearest is 36")
        assert len((await camera.cut(registered(3), found(3))).objects) == 1
        load = await load_when(rig, lambda load: load.inferred == 2)
    assert load.dropped[f"points: {FLUSHED}"] == 1


async def test_a_clock_that_jumps_back_starts_over() -> None:
    async with working() as rig, wanted(rig) as camera:
        for seq, instant in enumerate((100, 101, 3, 4)):
            points = registered(instant)
            seen = msgspec.structs.replace(found(0), header=about(seq, stamp_ns=points.header.stamp_ns))
            made = await camera.cut(points, seen)
            assert (made.header.seq, len(made.objects)) == (seq, 1)


async def test_a_loop_of_transforms_is_a_reason_and_clouds_go_on() -> None:
    loop = placed("base_link", "odom")
    loop = msgspec.structs.replace(
        loop,
        transforms=[*loop.transforms, *placed("odom", "base_link").transforms, *placed("odom", OPTICAL).transforms],
    )
    async with working() as rig, wanted(rig) as camera:
        await rig.transforms(loop)
        made = await camera.cut(registered(1), found(1))
        while "ancestor" not in made.unknown_target:  # those sent before the worker had the transforms
            made = await camera.cut(registered(made.header.seq + 1), found(made.header.seq + 1))
    assert made.target is None
    assert (len(made.objects), made.objects[0].in_target) == (1, None)


async def test_all_cameras_points_together_have_one_bound_and_what_it_costs_is_counted() -> None:
    greedy_key = CameraKey("r2", "front")
    async with working(memory_mib=16) as rig, rig.bus.subscribe("fleet/*/*/objects", QUEUE(9)):
        modest, greedy = await rig.camera(FRONT, *STREAMS), await rig.camera(greedy_key, *STREAMS)
        await until(lambda: modest[Stream.POINTS].wanted and greedy[Stream.POINTS].wanted)
        modest[Stream.POINTS].put(codec.encode(registered(0)))  # 4.7 MiB each
        await asyncio.sleep(0.01)
        for seq in range(5):
            sent = registered(seq)
            header = msgspec.structs.replace(sent.header, robot="r2")
            greedy[Stream.POINTS].put(codec.encode(msgspec.structs.replace(sent, header=header)))
            await asyncio.sleep(0.01)
        load = await load_when(rig, lambda load: load.robot == "r2" and sum(load.dropped.values()) == 3)
        assert load.dropped == {f"points: {CROWDED}": 3}
        assert (await load_when(rig, lambda load: load.robot == "r1")).dropped == {}
