"""The server's side of requests, the same for the real bus and the fake: bounded; every request is finished."""

import asyncio
import logging
import threading
from asyncio import AbstractEventLoop
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Final

from bus.api import MAX_REQUEST_BYTES, Handler, Reply, Request
from bus.delivery.inbox import Inbox
from bus.delivery.mailbox import Fifo
from bus.errors import BusError, RefusedError
from bus.keys import matches

MAX_OPEN_BYTES: Final = 64 << 20
"""Of the requests to a server that it handles or that wait; one alone may have any size that a request has."""

MAX_REASON: Final = 500
"""Longest error text that is sent, in characters."""

INTERNAL: Final = "internal error, see the server's log"

_log: Final = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class Call:
    """A request and its reply function.

    until_s: when its caller stops waiting, on the event loop's clock, which is `time.monotonic`. answer: takes a reply,
    an error's text, or None for nothing; any thread, once.
    """

    request: Request
    until_s: float
    answer: Callable[[Reply | str | None], None]


class Server:
    """Runs a handler for at most `at_once` requests while at most `waiting` others wait."""

    def __init__(self, key_expr: str, handler: Handler, loop: AbstractEventLoop, at_once: int, waiting: int) -> None:
        if at_once < 1 or waiting < 0:
            raise ValueError(
                f"a server handles at least 1 request at once and lets at least 0 wait, not {at_once} and {waiting}"
            )
        self.key = key_expr
        self._handler = handler
        self._loop = loop
        self._limit = at_once + waiting
        self._inbox: Inbox[Call] = Inbox(Fifo(self._limit), loop)
        self._slots = asyncio.Semaphore(at_once)
        self._lock = threading.Lock()
        self._open: set[Call] = set()
        self._bytes = 0
        self._ended = False
        self._running: asyncio.Task[None] | None = None

    def arrive(self, call: Call) -> None:
        """Add a request. Any thread."""
        with self._lock:
            size = len(call.request.payload)
            ended, under_way = self._ended, len(self._open)
            large = under_way > 0 and self._bytes + size > MAX_OPEN_BYTES
            full = large or under_way >= self._limit
            if not ended and not full:
                self._open.add(call)
                self._bytes += size
        if ended:
            call.answer(None)
        elif full:
            all_bytes = ", with all the bytes that there is room for" if large else ""
            call.answer(f"busy: {under_way} requests are under way already{all_bytes}")
        else:
            self._inbox.offer(call.request.key, call)

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[None]:
        """Answer requests until the context ends, then wait for the handlers to end. Event loop only."""
        self._running = self._loop.create_task(self._run())
        try:
            yield
        finally:
            self.end()
            await asyncio.wait({self._running})

    def end(self) -> None:
        """Cancel the handlers and drop the waiting requests. Event loop only."""
        with self._lock:
            self._ended = True
            rest = list(self._open)
        self._inbox.end()
        if self._running is not None:
            self._running.cancel()
        for call in rest:
            self._finish(call, None)

    async def _run(self) -> None:
        async with asyncio.TaskGroup() as group:
            while True:
                await self._slots.acquire()
                taken = await self._inbox.take()
                group.create_task(self._serve(taken.item))

    async def _serve(self, call: Call) -> None:
        try:
            self._finish(call, await self._outcome(call))
        finally:
            self._finish(call, None)
            self._slots.release()

    async def _outcome(self, call: Call) -> Reply | str:
        if self._loop.time() >= call.until_s:
            return "the request waited too long in the server's queue"
        try:
            async with asyncio.timeout_at(call.until_s):
                return _checked(await self._handler(call.request))
        except RefusedError as error:
            return _one_line(error)
        except Exception as error:  # noqa: BLE001 - whatever one request does to the handler, it fails alone
            if isinstance(error, TimeoutError) and self._loop.time() >= call.until_s:
                return "not done in time"
            _log.exception("%s: a request failed", call.request.key)
            return INTERNAL

    def _finish(self, call: Call, outcome: Reply | str | None) -> None:
        """Send the answer, once."""
        with self._lock:
            if call not in self._open:
                return
            self._open.discard(call)
            self._bytes -= len(call.request.payload)
        call.answer(outcome)


def serves(key_expr: str, declared: Iterable[object]) -> bool:
    """Return whether any declaration of a bus serves keys of the expression."""
    return any(isinstance(each, Server) and matches(each.key, key_expr) for each in declared)


def check_free(key_expr: str, declared: Iterable[object]) -> None:
    """Check that no server of the same bus already serves keys of the expression.

    Raises:
        BusError: one of its servers has keys of the expression already.

    """
    if serves(key_expr, declared):
        raise BusError(f"this bus serves keys of {key_expr} already")


def _checked(reply: Reply) -> Reply:
    if len(reply.payload) > MAX_REQUEST_BYTES:
        raise RefusedError(f"the reply has {len(reply.payload)} bytes, at most {MAX_REQUEST_BYTES} are sent")
    return reply


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:MAX_REASON] or type(error).__name__
