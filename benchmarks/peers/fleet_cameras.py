"""The cameras of a fleet, as its gateways offer them. Arguments: router, robots, cameras of each, frames a second.

64x48 rgb8 images, sent only while somebody wants them and, by the gateway's own rules, no more than consumers can use.
Says how many were sent.
"""

import asyncio
import random
import sys
import time
import uuid
from contextlib import AsyncExitStack
from typing import Final

from benchmarks.peers.answering import answer
from bus import Bus, BusSettings, Publisher, QoS, open_bus
from gateway.to_bus.shaping.consumers import Consumers
from schemas import codec
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream, StreamKey

HEIGHT: Final = 48
WIDTH: Final = 64
PIXELS: Final = memoryview(bytes(HEIGHT * WIDTH * 3))
SEED: Final = 5


class FleetCamera:
    """One camera."""

    def __init__(self, key: StreamKey, consumers: Consumers, publisher: Publisher, boot_id: str) -> None:
        self._key = key
        self._consumers = consumers
        self._publisher = publisher
        self._boot_id = boot_id
        self._numbered = 0

    @property
    def sent(self) -> int:
        """How many frames the link took."""
        return self._publisher.counts.put - self._publisher.counts.dropped

    async def run(self, hz: float, phase: float) -> None:
        """Send, for ever."""
        loop = asyncio.get_running_loop()
        due = loop.time() + phase / hz
        while True:
            await asyncio.sleep(max(0.0, due - loop.time()))
            due += 1 / hz
            now_ns = time.time_ns()
            if self._publisher.wanted and self._consumers.passes(self._key, now_ns):
                self._publisher.put(codec.encode(self._frame(now_ns)))
                self._numbered += 1

    def _frame(self, now_ns: int) -> ImageFrame:
        camera = self._key.camera
        header = Header(
            robot=camera.robot,
            camera=camera.camera,
            boot_id=self._boot_id,
            seq=self._numbered,
            stamp_ns=now_ns,
            frame_id="optical",
            received_ns=now_ns,
        )
        return ImageFrame(header=header, height=HEIGHT, width=WIDTH, encoding="rgb8", step=WIDTH * 3, data=PIXELS)


async def run(router: str, robots: int, cameras: int, hz: float) -> None:
    """Send until the standard input ends."""
    phases = random.Random(SEED)  # noqa: S311 - no secret
    made: list[FleetCamera] = []
    async with (
        open_bus(BusSettings(connect=[router], shared_memory=False)) as bus,
        AsyncExitStack() as stack,
        asyncio.TaskGroup() as group,
    ):
        for robot in range(1, robots + 1):
            consumers = Consumers(f"r{robot}", "", near=False)
            group.create_task(consumers.follow(bus))
            for camera in range(1, cameras + 1):
                key = StreamKey(CameraKey(f"r{robot}", f"c{camera}"), Stream.COLOR)
                made.append(await _offer(bus, stack, key, consumers))
        tasks = [group.create_task(camera.run(hz, phases.random())) for camera in made]
        await asyncio.to_thread(answer, lambda: {"sent": sum(camera.sent for camera in made)})
        for task in tasks:
            task.cancel()


async def _offer(bus: Bus, stack: AsyncExitStack, key: StreamKey, consumers: Consumers) -> FleetCamera:
    publisher = await stack.enter_async_context(bus.publisher(str(key), QoS.IMAGE, encoding=codec.encoding(ImageFrame)))
    await stack.enter_async_context(bus.announce(key.alive))
    return FleetCamera(key, consumers, publisher, uuid.uuid4().hex)


if __name__ == "__main__":
    asyncio.run(run(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])))
