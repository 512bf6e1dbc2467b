"""The transforms of the robots on a map that somebody looks at."""

import asyncio
import logging
from typing import Final

from bus import QUEUE, Bus
from bus.clocks import clock_id
from schemas import codec, keys
from schemas.errors import SchemaError
from schemas.keys import RobotStreamKey, Wanted
from schemas.transforms import Transforms
from services.monitor.live_views.shared import Shared
from services.monitor.mapping.pose import Whereabouts

log = logging.getLogger(__name__)

MOST_ROBOTS: Final = 64
"""How many robots' transforms are subscribed to at the same time: some robots send hundreds a second."""

DEPTH: Final = 1_000

Robots = Shared[str, Whereabouts]


def robots(bus: Bus) -> Robots:
    """Return where the robots are that people look at; each one's transforms are subscribed to while anybody does."""
    return Shared(lambda _: Whereabouts(), lambda robot, where: follow(bus, robot, where), MOST_ROBOTS)


async def follow(bus: Bus, robot: str, where: Whereabouts) -> None:
    """Keep up to date where a robot is until cancelled."""
    moving = RobotStreamKey(robot, keys.TF)
    token = Wanted(moving, clock_id())
    async with bus.announce(str(token)), asyncio.TaskGroup() as group:
        group.create_task(_take(bus, RobotStreamKey(robot, keys.TF_STATIC), where))
        group.create_task(_take(bus, moving, where))


async def _take(bus: Bus, key: RobotStreamKey, where: Whereabouts) -> None:
    static = key.stream == keys.TF_STATIC
    async with bus.subscribe(str(key), QUEUE(DEPTH), history=static) as subscription:
        async for sample in subscription:
            try:
                transforms = codec.decode(Transforms, sample.payload, sample.encoding)
                codec.check_identity(transforms.header, key)
            except SchemaError as error:
                log.warning("%s: left out: %s", key, error)
                continue
            where.take(transforms, sample.received_ns, static=static)
