"""Reads the clocks of robots, so that the ages of their messages are known."""

import asyncio
import logging
import time
from typing import Final

from bus import Bus, RequestError
from schemas import codec, keys
from schemas.errors import SchemaError
from schemas.status import ClockReading
from services.monitor.fleet import Fleet

log = logging.getLogger(__name__)

LOOK_S: Final = 1.0
TIMEOUT_S: Final = 2.0
AT_ONCE: Final = 64
"""Number of robots asked concurrently."""


async def measure_clocks(bus: Bus, fleet: Fleet) -> None:
    """Keep the fleet's clock offsets up to date until cancelled."""
    room = asyncio.Semaphore(AT_ONCE)
    while True:
        async with asyncio.TaskGroup() as group:
            for robot in fleet.clocks.due(fleet.elsewhere(), time.monotonic()):
                group.create_task(_measure(bus, fleet, robot, room))
        await asyncio.sleep(LOOK_S)


async def _measure(bus: Bus, fleet: Fleet, robot: str, room: asyncio.Semaphore) -> None:
    async with room:
        asked_ns = time.time_ns()
        try:
            reply = await bus.request(keys.robot_clock(robot), timeout_s=TIMEOUT_S)
            answered_ns = time.time_ns()
            reading = codec.decode(ClockReading, reply.payload, reply.encoding)
        except (RequestError, SchemaError) as error:
            log.debug("the clock of %s is not known: %s", robot, error)
            return
    fleet.clocks.take(robot, reading, asked_ns=asked_ns, answered_ns=answered_ns)
