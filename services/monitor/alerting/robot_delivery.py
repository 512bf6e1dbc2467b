"""Publishes alerts and actions on the key of each robot: in order per robot, and no robot waits for another."""

import asyncio
import logging
from collections import OrderedDict, deque
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack, suppress
from typing import Final, Generic, TypeVar

from bus import Bus, BusError, Publisher, QoS
from schemas import codec
from schemas.alerts import Action, Alert
from schemas.keys import ACTIONS, ALERTS, RobotStreamKey

K = TypeVar("K")
M = TypeVar("M")

MAX_WAITING: Final = 1_000
"""Maximum number of messages waiting in one lane; the oldest are dropped."""

AT_ONCE: Final = 256
"""Number of lanes that deliver concurrently."""


class Lanes(Generic[K, M]):
    """Delivers messages by receiver. deliver: gives one message to a receiver; it must not raise.

    gave_up: is told of each message that was given up for a newer one, and whether it is the first since the receiver
    had all of them.
    """

    def __init__(self, deliver: Callable[[K, M], Awaitable[None]], gave_up: Callable[[K, bool], None]) -> None:
        self._deliver = deliver
        self._gave_up = gave_up
        self._lanes: dict[K, deque[M]] = {}
        self._full: set[K] = set()
        self._busy: set[K] = set()
        self._news = asyncio.Event()

    def put(self, receiver: K, message: M) -> None:
        """Queue a message for delivery."""
        lane = self._lanes.setdefault(receiver, deque(maxlen=MAX_WAITING))
        is_full = len(lane) == MAX_WAITING
        lane.append(message)
        self._news.set()
        if is_full:
            first = receiver not in self._full
            self._full.add(receiver)
            self._gave_up(receiver, first)

    async def run(self) -> None:
        """Deliver queued messages until cancelled."""
        async with asyncio.TaskGroup() as group:
            while True:
                await self._news.wait()
                self._news.clear()
                for receiver in [each for each in self._lanes if each not in self._busy]:
                    if len(self._busy) < AT_ONCE:
                        self._busy.add(receiver)
                        group.create_task(self._empty(receiver))

    async def _empty(self, receiver: K) -> None:
        lane = self._lanes[receiver]
        while lane:
            await self._deliver(receiver, lane.popleft())
        del self._lanes[receiver]
        self._full.discard(receiver)
        self._busy.discard(receiver)
        self._news.set()


log = logging.getLogger(__name__)

MAX_PUBLISHERS: Final = 4_096
"""How many keys are kept declared, for late subscribers and for speed; the one used longest ago is the next to go.

Each that is declared again takes another number of the session's (see bus.session.known_keys).
"""

HEARD_S: Final = 10.0
"""Seconds an action waits for its robot's gateway to be discovered."""


class ToRobots:
    """Sends messages of one kind to robots, in order per robot.

    patient: a robot's first message waits for a subscriber, but not for long: it has no other chance to be heard.
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
