"""Another program of the fleet, which notes when each message of an image comes."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Final

from benchmarks.guide.hops import Seen
from bus import QUEUE, Bus, BusSettings, Sample, open_bus
from bus.clocks import clock_id
from bus.errors import BusError
from schemas import codec, keys
from schemas.consumer_keys import Wanted
from schemas.detections import ClassList, Detections
from schemas.distances import Distances
from schemas.image import ImageFrame
from schemas.inventory import InventoryAnswer, InventoryRequest
from schemas.keys import CameraKey, Stream, StreamKey
from schemas.objects import ObjectClouds

CAMERA: Final = CameraKey("r1", "camera")
Message = ImageFrame | Detections | ClassList | Distances | ObjectClouds
SCHEMAS: Final[dict[Stream, type[Message]]] = {
    Stream.COLOR: ImageFrame,
    Stream.DETECTIONS: Detections,
    Stream.CLASSES: ClassList,
    Stream.DISTANCES: Distances,
    Stream.OBJECTS: ObjectClouds,
    Stream.OVERLAY_DETECTION: ImageFrame,
    Stream.OVERLAY_SEGMENTATION: ImageFrame,
}
WAITING: Final = 100
TOLD_S: Final = 0.8
ASK_AGAIN_S: Final = 0.001
"""Whoever asks without a pause takes the time of those that have work to do."""
LATITUDE_NS: Final = 500_000_000
"""The monitor's times are measured, not exact; images are further apart."""


class Observer:
    """What came, by the image's stamp, which all of an instant share."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._seen: dict[int, Seen] = {}

    @property
    def seen(self) -> list[Seen]:
        """What was seen of each image so far."""
        return list(self._seen.values())

    async def receive(self, stream: Stream) -> None:
        """Note a stream's messages for ever."""
        async with self._bus.subscribe(CAMERA.stream(stream), QUEUE(WAITING), history=False) as samples:
            async for sample in samples:
                seen = self._take(stream, sample)
                if stream is Stream.CLASSES:
                    seen.told_ns = await self._told_ns(seen.stamp_ns - LATITUDE_NS)

    def _take(self, stream: Stream, sample: Sample) -> Seen:
        message: Message = codec.decode(SCHEMAS[stream], sample.payload, sample.encoding)
        seen = self._seen.setdefault(message.header.stamp_ns, Seen(message.header.stamp_ns))
        seen.at_ns[stream] = sample.received_ns
        seen.sizes[stream] = len(sample.payload)
        if stream is Stream.COLOR:
            seen.received_ns = message.header.received_ns
        if not isinstance(message, ImageFrame):
            seen.spans |= message.spans
        return seen

    async def _told_ns(self, since_ns: int) -> int | None:
        """Ask the monitor until it knows of an image that the gateway had after a time; None if it never says so."""
        asked = codec.encode(InventoryRequest(robot=CAMERA.robot, in_view=True))
        until_s = time.monotonic() + TOLD_S
        while time.monotonic() < until_s:
            try:
                reply = await self._bus.request(
                    keys.INVENTORY, asked, encoding=codec.encoding(InventoryRequest), timeout_s=TOLD_S
                )
            except BusError:
                return None
            answer = codec.decode(InventoryAnswer, reply.payload, reply.encoding)
            if any(each.last_ns > since_ns for each in answer.sightings):
                return time.time_ns()
            await asyncio.sleep(ASK_AGAIN_S)
        return None


@asynccontextmanager
async def observing(endpoint: str) -> AsyncIterator[Observer]:
    """Observe the robot's camera, as a consumer of the same machine, for as long as the context lasts."""
    async with AsyncExitStack() as stack:
        bus = await stack.enter_async_context(open_bus(BusSettings(connect=[endpoint])))
        await stack.enter_async_context(
            bus.announce(str(Wanted(StreamKey(CAMERA, Stream.COLOR), clock_id(), "observer")))
        )
        made = Observer(bus)
        group = await stack.enter_async_context(asyncio.TaskGroup())
        receiving = [group.create_task(made.receive(stream)) for stream in SCHEMAS]
        try:
            yield made
        finally:
            for task in receiving:
                task.cancel()
