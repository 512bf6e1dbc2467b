"""A distance worker on a fake bus, and its robot and detector as a test has them."""

import asyncio
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Executor
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Final

import msgspec

from bus import QUEUE, Bus, Publisher, QoS
from schemas import codec, keys, worker_keys
from schemas.camera_info import CameraInfo
from schemas.detections import Detections
from schemas.distances import Distances
from schemas.image import ImageFrame
from schemas.keys import CameraKey, RobotStreamKey, Stream
from schemas.status import CameraLoad, WorkerStatus
from schemas.transforms import Transforms
from services.distance.process import DistanceWorker
from services.distance.settings import DistanceSettings
from tests.waiting import receive, until

FRONT: Final = CameraKey("r1", "front")
STREAMS: Final[dict[Stream, tuple[type[msgspec.Struct], QoS]]] = {
    Stream.DETECTIONS: (Detections, QoS.RESULT),
    Stream.DEPTH: (ImageFrame, QoS.IMAGE),
    Stream.INFO: (CameraInfo, QoS.LATCHED),
    Stream.DEPTH_INFO: (CameraInfo, QoS.LATCHED),
}


class Robot:
    """Publishers of one camera's streams and of its robot's transforms."""

    def __init__(self, publishers: dict[str, Publisher]) -> None:
        self._publishers = publishers

    def send(self, stream: str, message: codec.Message | bytes) -> None:
        payload = message if isinstance(message, bytes) else codec.encode(message)
        self._publishers[stream].put(payload)

    def wanted(self, stream: str) -> bool:
        return self._publishers[stream].wanted

    async def until_wanted(self, *, wanted: bool = True) -> None:
        await until(
            lambda: all(each.wanted == wanted for each in self._publishers.values()), f"all streams wanted: {wanted}"
        )


@asynccontextmanager
async def robot(bus: Bus, camera: CameraKey = FRONT) -> AsyncIterator[Robot]:
    async with AsyncExitStack() as stack:
        publishers: dict[str, Publisher] = {}
        for stream, (schema, qos) in STREAMS.items():
            publisher = bus.publisher(camera.stream(stream), qos, encoding=codec.encoding(schema))
            publishers[stream] = await stack.enter_async_context(publisher)
        for name in (keys.TF, keys.TF_STATIC):
            key = str(RobotStreamKey(camera.robot, name))
            publisher = bus.publisher(key, QoS.LATCHED, encoding=codec.encoding(Transforms))
            publishers[name] = await stack.enter_async_context(publisher)
        await stack.enter_async_context(bus.announce(camera.alive(Stream.COLOR)))
        yield Robot(publishers)


@asynccontextmanager
async def working(bus: Bus, executor: Executor, **settings: object) -> AsyncIterator[None]:
    """Run a worker called w1."""
    made = DistanceSettings.model_validate({"worker": "w1", **settings})
    async with asyncio.TaskGroup() as group:
        task = group.create_task(DistanceWorker(bus, made, executor, join_s=0).run())
        yield
        task.cancel()


async def load(bus: Bus, so: Callable[[CameraLoad], bool]) -> CameraLoad:
    """Wait for the worker's tally of a camera to be such."""
    async with bus.subscribe(worker_keys.worker_status("distance", "w1"), QUEUE(9)) as statuses, asyncio.timeout(60):
        while True:
            for each in (await receive(statuses, WorkerStatus)).cameras:
                if so(each):
                    return each


def only(seen: Distances) -> tuple[float | None, str]:
    """Return the distance of the only object, or why it is not known."""
    (found,) = seen.objects
    return (found.measured.axial_m if found.measured else None), found.unknown
