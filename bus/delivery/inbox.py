"""Passes items from any thread to an async iterator, with at most one pending call into the event loop."""

import asyncio
import contextlib
import threading
from asyncio import AbstractEventLoop
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from bus.delivery.mailbox import Mailbox, Taken
from bus.errors import BusError

T = TypeVar("T")


class Inbox(Generic[T]):
    """A mailbox that many threads fill and one task empties."""

    def __init__(self, mailbox: Mailbox[str, T], loop: AbstractEventLoop) -> None:
        self._mailbox = mailbox
        self._loop = loop
        self._lock = threading.Lock()
        self._waiter: asyncio.Future[None] | None = None
        self._called = False
        self._ended = False
        self.received = 0
        self.dropped = 0
        self.missed = 0
        self.unread = 0

    def offer(self, key: str, item: T) -> None:
        """Add an item. Any thread; never waits for the reader."""
        self.offer_all([(key, item)])

    def offer_all(self, items: Sequence[tuple[str, T]]) -> None:
        """Add several items, in order. Any thread; never waits for the reader."""
        with self._lock:
            if self._ended or not items:
                return
            self.received += len(items)
            self.unread += len(items)
            for key, item in items:
                self.dropped += self._mailbox.offer(key, item)
            if self._waiter is None or self._called:
                return
            self._called = True
        call_soon(self._loop, self._wake)

    def miss(self, number: int) -> None:
        """Count items that are lost. Any thread."""
        with self._lock:
            self.missed += number

    def end(self) -> None:
        """End the iteration and reject further items. Event loop only."""
        with self._lock:
            self._ended = True
        self._wake()

    async def take(self) -> Taken[str, T]:
        """Wait for the next item.

        Raises:
            StopAsyncIteration: the inbox has ended.
            BusError: another task is waiting.

        """
        if self._waiter is not None:
            raise BusError("two tasks cannot iterate over the same subscription or watch")
        while True:
            with self._lock:
                if self._ended:
                    raise StopAsyncIteration
                taken = self._take()
                if taken is not None:
                    return taken
                waiter = self._waiter = self._loop.create_future()
            try:
                await waiter
            finally:
                self._waiter = None

    def take_waiting(self, most: int, most_bytes: int, size: Callable[[T], int]) -> list[Taken[str, T]]:
        """Take the items that wait, in order, without waiting for more. size: the bytes of one."""
        found: list[Taken[str, T]] = []
        with self._lock:
            while len(found) < most and most_bytes > 0 and (taken := self._take()) is not None:
                found.append(taken)
                most_bytes -= size(taken.item)
        return found

    def _take(self) -> Taken[str, T] | None:
        taken = self._mailbox.take()
        if taken is not None:
            self.unread -= 1 + taken.dropped
        return taken

    def _wake(self) -> None:
        with self._lock:
            self._called = False
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)


def call_soon(loop: AbstractEventLoop, callback: Callable[[], object]) -> None:
    """Call a function on the event loop, from any thread; does nothing once the loop is closed."""
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(callback)
