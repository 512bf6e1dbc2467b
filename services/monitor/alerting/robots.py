"""Alerts and actions to robots, each on its robot's key."""

import asyncio
import logging
from collections import OrderedDict, deque
from contextlib import AsyncExitStack, suppress
from typing import Final

from bus import Bus, BusError, Publisher, QoS
from schemas import codec
from schemas.alerts import Action, Alert
from schemas.keys import ACTIONS, ALERTS, RobotStreamKey

log = logging.getLogger(__name__)

MAX_WAITING: Final = 10_000
MAX_PUBLISHERS: Final = 256
"""How many keys are kept declared, for late subscribers and for speed; the one used longest ago is the next to go."""

HEARD_S: Final = 1.0
"""How long an action waits for its robot's gateway to be found."""


class ToRobots:
    """Sends messages of one kind to robots, in order. given_up: messages dropped because too many waited.

    patient: a message waits until somebody listens, for there is no other chance to be heard; not for long.
    """

    def __init__(self, stream: str, schema: type[Alert | Action], *, patient: bool) -> None:
        self.given_up = 0
        self._stream = stream
        self._schema = schema
        self._patient = patient
        self._waiting: deque[Alert | Action] = deque()
        self._news = asyncio.Event()
        self._publishers: OrderedDict[str, tuple[Publisher, AsyncExitStack]] = OrderedDict()

    def send(self, message: Alert | Action) -> None:
        """Have a message sent."""
        if len(self._waiting) >= MAX_WAITING:
            self._waiting.popleft()
            self.given_up += 1
        self._waiting.append(message)
        self._news.set()

    async def run(self, bus: Bus) -> None:
        """Send what there is to send, for ever."""
        try:
            while True:
                await self._news.wait()
                self._news.clear()
                while self._waiting:
                    await self._send(bus, self._waiting.popleft())
        finally:
            for _, stack in self._publishers.values():
                await stack.aclose()

    async def _send(self, bus: Bus, message: Alert | Action) -> None:
        try:
            publisher = await self._publisher(bus, message.robot)
            publisher.put(codec.encode(message))
        except BusError as error:
            log.warning("%s of %s was not sent: %s", self._stream, message.robot, error)

    async def _publisher(self, bus: Bus, robot: str) -> Publisher:
        if robot not in self._publishers:
            self._publishers[robot] = await self._declare(bus, robot)
        self._publishers.move_to_end(robot)
        while len(self._publishers) > MAX_PUBLISHERS:
            _, (_, stack) = self._publishers.popitem(last=False)
            await stack.aclose()
        return self._publishers[robot][0]

    async def _declare(self, bus: Bus, robot: str) -> tuple[Publisher, AsyncExitStack]:
        heard = asyncio.Event()
        key = str(RobotStreamKey(robot, self._stream))
        stack = AsyncExitStack()

        def on_demand(wanted: bool) -> None:  # noqa: FBT001 - the bus's
            if wanted:
                heard.set()

        declared = bus.publisher(key, QoS.RESULT, encoding=codec.encoding(self._schema), on_demand=on_demand)
        publisher = await stack.enter_async_context(declared)
        if self._patient and not publisher.wanted:
            with suppress(TimeoutError):
                async with asyncio.timeout(HEARD_S):
                    await heard.wait()
        return publisher, stack


def alerts_to_robots() -> ToRobots:
    """Return what sends alerts."""
    return ToRobots(ALERTS, Alert, patient=False)


def actions_to_robots() -> ToRobots:
    """Return what sends actions."""
    return ToRobots(ACTIONS, Action, patient=True)
