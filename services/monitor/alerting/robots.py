"""Publishes alerts and actions on each robot's key."""

import asyncio
import logging
from collections import OrderedDict
from contextlib import AsyncExitStack, suppress
from typing import Final

from bus import Bus, BusError, Publisher, QoS
from schemas import codec
from schemas.alerts import Action, Alert
from schemas.keys import ACTIONS, ALERTS, RobotStreamKey
from services.monitor.alerting.ordered_delivery import Lanes

log = logging.getLogger(__name__)

MAX_PUBLISHERS: Final = 4_096
"""How many keys are kept declared, for late subscribers and for speed; the one used longest ago is the next to go.

Each that is declared again takes another number of the session's (see bus.session.known_keys).
"""

HEARD_S: Final = 10.0
"""Seconds an action waits for its robot's gateway to be discovered."""


class ToRobots:
    """Sends messages of one kind to robots, in order per robot.

    patient: a robot's first message waits until somebody listens, but not for long: it has no other chance to be heard.
    """

    def __init__(self, stream: str, schema: type[Alert | Action], *, patient: bool) -> None:
        self._stream = stream
        self._schema = schema
        self._patient = patient
        self._bus: Bus | None = None
        self._lanes = Lanes(self._deliver, self._gave_up)
        self._publishers: OrderedDict[str, tuple[Publisher, AsyncExitStack]] = OrderedDict()

    def send(self, message: Alert | Action) -> None:
        """Queue a message."""
        self._lanes.put(message.robot, message)

    async def run(self, bus: Bus) -> None:
        """Send queued messages until cancelled."""
        self._bus = bus
        try:
            await self._lanes.run()
        finally:
            for _, stack in self._publishers.values():
                await stack.aclose()

    async def _deliver(self, robot: str, message: Alert | Action) -> None:
        try:
            publisher = await self._publisher(robot)
            publisher.put(codec.encode(message))
        except BusError as error:
            log.warning("%s of %s was not sent: %s", self._stream, robot, error)

    def _gave_up(self, robot: str, first: bool) -> None:  # noqa: FBT001 - the lanes'
        if first:
            log.warning("%s of %s: too many are waiting, the oldest are dropped", self._stream, robot)

    async def _publisher(self, robot: str) -> Publisher:
        if robot not in self._publishers:
            self._publishers[robot] = await self._declare(robot)
        self._publishers.move_to_end(robot)
        publisher = self._publishers[robot][0]
        while len(self._publishers) > MAX_PUBLISHERS:
            _, (_, stack) = self._publishers.popitem(last=False)
            await stack.aclose()
        return publisher

    async def _declare(self, robot: str) -> tuple[Publisher, AsyncExitStack]:
        heard = asyncio.Event()

        def on_demand(wanted: bool) -> None:  # noqa: FBT001 - the bus's
            if wanted:
                heard.set()

        assert self._bus is not None, "messages are delivered while it runs"  # noqa: S101 - for the type
        stack = AsyncExitStack()
        key, encoding = str(RobotStreamKey(robot, self._stream)), codec.encoding(self._schema)
        declared = self._bus.publisher(key, QoS.RESULT, encoding=encoding, on_demand=on_demand)
        publisher = await stack.enter_async_context(declared)
        if self._patient and not publisher.wanted:
            with suppress(TimeoutError):
                async with asyncio.timeout(HEARD_S):
                    await heard.wait()
        return publisher, stack


def alerts_to_robots() -> ToRobots:
    """Return the sender of alerts; late subscribers get the last one from the bus."""
    return ToRobots(ALERTS, Alert, patient=False)


def actions_to_robots() -> ToRobots:
    """Return the sender of actions; gateways never take an old one."""
    return ToRobots(ACTIONS, Action, patient=True)
