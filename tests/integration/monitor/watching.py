"""A camera's class lists as a detector publishes them, and what the monitor says of them."""

import asyncio
import itertools
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from bus import Publisher, QoS, RequestError
from schemas import codec, keys
from schemas.detections import KEPT_LISTS, ClassList
from schemas.inventory import InventoryAnswer
from schemas.keys import Stream
from tests.integration.fleet import PATIENCE_S, FleetRig
from tests.services.monitor.inventory.seeing import FRONT, seen

HZ = 25


class Camera:
    """Publishes class lists as a detector does. sent: how many there were. names: what is in view all the time."""

    def __init__(self, publisher: Publisher) -> None:
        self.sent = 0
        self.names: tuple[str, ...] = ()
        self._publisher = publisher

    def put(self, *names: str) -> None:
        self.sent += 1
        self._publisher.put(codec.encode(seen(self.sent, dict.fromkeys(names, 1))))

    async def watch(self, seconds: float, *now_and_then: str) -> None:
        """See a box all the time, and others in every fifth list."""
        until_s = time.monotonic() + seconds
        for number in itertools.count():
            self.put("box", *(now_and_then if number % 5 == 0 else ()))
            await asyncio.sleep(1 / HZ)
            if time.monotonic() >= until_s:
                return


@asynccontextmanager
async def camera(rig: FleetRig) -> AsyncIterator[Camera]:
    key, encoding = FRONT.stream(Stream.CLASSES), codec.encoding(ClassList)
    async with rig.bus.publisher(key, QoS.RESULT, encoding=encoding, kept=KEPT_LISTS) as publisher:
        yield Camera(publisher)


@asynccontextmanager
async def always_seeing(rig: FleetRig, *names: str) -> AsyncIterator[Camera]:
    """See something all the time."""
    async with (
        rig.bus.announce(keys.robot_alive(FRONT.robot)),
        rig.bus.announce(FRONT.alive(Stream.COLOR)),
        camera(rig) as front,
    ):
        front.names = names

        async def see() -> None:
            while True:
                front.put(*front.names)
                await asyncio.sleep(1 / HZ)

        running = asyncio.create_task(see())
        try:
            yield front
        finally:
            running.cancel()
            await asyncio.wait([running])


async def inventory(rig: FleetRig) -> InventoryAnswer:
    """Return what the monitor says, once it says something."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            try:
                reply = await rig.bus.request(keys.INVENTORY, timeout_s=5)
            except RequestError:
                await asyncio.sleep(0.1)
            else:
                return codec.decode(InventoryAnswer, reply.payload, reply.encoding)


async def told(rig: FleetRig, until: Callable[[InventoryAnswer], object]) -> InventoryAnswer:
    """Wait until the monitor says such a thing; return it."""
    async with asyncio.timeout(PATIENCE_S):
        while not until(answer := await inventory(rig)):  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0.1)
    return answer


async def taken(rig: FleetRig, number: int) -> InventoryAnswer:
    """Wait until the monitor has taken in so many class lists."""
    return await told(rig, lambda answer: answer.class_lists >= number)
