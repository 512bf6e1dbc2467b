"""The caller's side of a request, the same for the real bus and the fake."""

import asyncio
from asyncio import AbstractEventLoop
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Final

from bus.api import MAX_REQUEST_BYTES, MAX_TIMEOUT_S, Reply
from bus.delivery.inbox import call_soon
from bus.errors import BusClosedError, BusError, NotServedError, RefusedError, RequestTimeoutError

MAX_UNANSWERED: Final = 256
"""Most pending requests of one bus."""

Outcome = Reply | BusError


class PendingRequest:
    """One pending request: the first outcome counts, later ones are ignored."""

    def __init__(self, key: str, payload: bytes | bytearray, encoding: str, timeout_s: float) -> None:
        if not isinstance(payload, bytes | bytearray):
            raise TypeError(f"a payload is bytes or bytearray, not {type(payload).__name__}")
        if len(payload) > MAX_REQUEST_BYTES:
            raise BusError(f"a request of {len(payload)} bytes, at most {MAX_REQUEST_BYTES} are sent")
        if not 0 < timeout_s <= MAX_TIMEOUT_S:
            raise BusError(f"a request takes at most {MAX_TIMEOUT_S:g} s, not {timeout_s:g}")
        self.key = key
        self.payload = payload
        self.encoding = encoding
        self.timeout_s = timeout_s
        self._loop: AbstractEventLoop = asyncio.get_running_loop()
        self._outcome: asyncio.Future[Outcome] = self._loop.create_future()

    def settle(self, outcome: Outcome) -> None:
        """Set the outcome. Any thread."""
        call_soon(self._loop, partial(self._set, outcome))

    def refuse(self, reason: str) -> None:
        """Fail with a server's error. Any thread."""
        self.settle(RefusedError(reason))

    def give_up(self) -> None:
        """Fail because no server answers; ignored after an answer. Any thread."""
        self.settle(NotServedError("no server has this key, or it left before answering"))

    def end(self) -> None:
        """Fail because the bus is closed. Event loop only."""
        self._set(BusClosedError("the bus was closed before an answer came"))

    async def answered(self) -> Reply:
        """Wait for the outcome; see `bus.api.Bus.request`."""
        try:
            async with asyncio.timeout(self.timeout_s):
                outcome = await self._outcome
        except TimeoutError:
            raise RequestTimeoutError(f"no answer within {self.timeout_s:g} s") from None
        if isinstance(outcome, BusError):
            raise outcome
        return outcome

    def _set(self, outcome: Outcome) -> None:
        if not self._outcome.done():
            self._outcome.set_result(outcome)


class Unanswered:
    """The pending requests of a bus. Event loop only."""

    def __init__(self) -> None:
        self._askings: set[PendingRequest] = set()

    @contextmanager
    def holding(self, asking: PendingRequest) -> Iterator[None]:
        """Count a request as pending while the context lasts.

        Raises:
            BusError: MAX_UNANSWERED are already.

        """
        if len(self._askings) >= MAX_UNANSWERED:
            raise BusError(f"{MAX_UNANSWERED} requests are unanswered already")
        self._askings.add(asking)
        try:
            yield
        finally:
            self._askings.discard(asking)

    def end(self) -> None:
        """Fail all of them because the bus is closed."""
        for asking in self._askings:
            asking.end()
