"""Delivers messages in order per receiver; no receiver waits for another."""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Final, Generic, TypeVar

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
