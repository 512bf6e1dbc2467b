"""The poses of watched robots: their transforms are subscribed to while a page shows the map."""

import asyncio
import logging
from collections.abc import Iterable, Mapping
from contextlib import AsyncExitStack
from types import TracebackType
from typing import Final, Self

from bus import QUEUE, Bus
from bus.clocks import clock_id
from schemas import codec, keys
from schemas.consumer_keys import Wanted, new_consumer
from schemas.errors import SchemaError
from schemas.keys import RobotStreamKey
from schemas.transforms import Transforms
from services.monitor.live_views.shared import CrowdedError, SharedSubscriptions
from services.monitor.map.pose import Whereabouts

log = logging.getLogger(__name__)

MOST_ROBOTS: Final = 64
"""Maximum number of robots whose transforms are subscribed to: some robots send hundreds a second."""

WAITING: Final = QUEUE(1_000, 16 << 20)

Robots = SharedSubscriptions[str, Whereabouts]


def robots(bus: Bus) -> Robots:
    """Return the poses of watched robots; each one's transforms are subscribed to while somebody watches."""
    return SharedSubscriptions(lambda _: Whereabouts(), lambda robot, where: follow(bus, robot, where), MOST_ROBOTS)


async def follow(bus: Bus, robot: str, where: Whereabouts) -> None:
    """Keep a robot's pose up to date until cancelled."""
    moving = RobotStreamKey(robot, keys.TF)
    token = Wanted(moving, clock_id(), new_consumer(bus.certificate))
    async with bus.announce(str(token)), asyncio.TaskGroup() as group:
        group.create_task(_take(bus, RobotStreamKey(robot, keys.TF_STATIC), where))
        group.create_task(_take(bus, moving, where))


async def _take(bus: Bus, key: RobotStreamKey, where: Whereabouts) -> None:
    static = key.stream == keys.TF_STATIC
    async with bus.subscribe(str(key), WAITING, history=static) as subscription:
        async for sample in subscription:
            try:
                transforms = codec.decode(Transforms, sample.payload, sample.encoding)
                codec.check_identity(transforms.header, key)
            except SchemaError as error:
                log.warning("%s: left out: %s", key, error)
                continue
            where.take(transforms, sample.received_ns, static=static)


class HeldRobots:
    """Follows robots within a context. crowded: why some are not followed, or empty."""

    def __init__(self, robots: Robots) -> None:
        self._robots = robots
        self._held: dict[str, tuple[AsyncExitStack, Whereabouts]] = {}
        self.crowded = ""

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.keep(())

    async def keep(self, wanted: Iterable[str]) -> Mapping[str, Whereabouts]:
        """Follow exactly these robots; return their poses, as far as the limit allows."""
        names = list(wanted)
        for gone in self._held.keys() - set(names):
            stack, _ = self._held.pop(gone)
            await stack.aclose()
        self.crowded = ""
        for name in names:
            if name not in self._held:
                await self._hold(name)
        return {name: where for name, (_, where) in self._held.items()}

    async def _hold(self, name: str) -> None:
        async with AsyncExitStack() as stack:
            try:
                where = await stack.enter_async_context(self._robots.hold(name))
            except CrowdedError as error:
                self.crowded = str(error)
                return
            self._held[name] = stack.pop_all(), where
