"""Demand for a publisher's messages, and work that runs only while there is demand."""

import asyncio
import threading
from asyncio import AbstractEventLoop
from collections.abc import Callable, Coroutine

from bus.delivery.inbox import call_soon


class Demand:
    """The current demand for a publisher; changes in quick succession are merged."""

    def __init__(self, loop: AbstractEventLoop, on_demand: Callable[[bool], None] | None) -> None:
        self._loop = loop
        self._on_demand = on_demand
        self._lock = threading.Lock()
        self._newest = False
        self._heard = False
        self._called = False
        self._ended = False
        self.wanted = False

    def offer(self, *, wanted: bool, initial: bool = False) -> None:
        """Set the demand; an `initial` value is ignored if one was set before. Any thread."""
        with self._lock:
            if initial and self._heard:
                return
            self._heard = True
            self._newest = wanted
            if self._called or self._ended:
                return
            self._called = True
        call_soon(self._loop, self._tell)

    def forget(self) -> None:
        """Assume no demand until the next value, which may be an initial one. Any thread."""
        self.offer(wanted=False)
        with self._lock:
            self._heard = False

    def end(self) -> None:
        """Stop reporting demand. Event loop only."""
        self._ended = True
        self.wanted = False

    def _tell(self) -> None:
        with self._lock:
            self._called = False
            newest = self._newest
        if self._ended or newest == self.wanted:
            return
        self.wanted = newest
        if self._on_demand is not None:
            self._on_demand(newest)


class SharedDemand:
    """The joint demand for several publishers. Event loop only."""

    def __init__(self) -> None:
        self._wanted: set[str] = set()
        self._on = asyncio.Event()
        self._off = asyncio.Event()
        self._off.set()

    def of(self, publisher: str) -> Callable[[bool], None]:
        """Return the `on_demand` callback of one publisher."""

        def update(wanted: bool) -> None:  # noqa: FBT001 - the bus calls it so
            (self._wanted.add if wanted else self._wanted.discard)(publisher)
            (self._on.set if self._wanted else self._on.clear)()
            (self._off.clear if self._wanted else self._off.set)()

        return update

    @property
    def wanted(self) -> bool:
        """Whether any of the publishers is wanted now."""
        return bool(self._wanted)

    async def until(self, *, wanted: bool) -> None:
        """Wait until any of the publishers is wanted, or until none is."""
        await (self._on if wanted else self._off).wait()


async def while_wanted(
    demand: SharedDemand, work: Callable[[], Coroutine[None, None, None]], *, linger_s: float = 0.0
) -> None:
    """Run `work` whenever there is demand, for ever; cancel it when there was none for `linger_s` seconds on end.

    For work that takes long to begin: it lives on through a demand that blinks.
    """
    while True:
        await demand.until(wanted=True)
        async with asyncio.TaskGroup() as group:
            working = group.create_task(work())
            await _none_for(demand, linger_s)
            working.cancel()


async def _none_for(demand: SharedDemand, linger_s: float) -> None:
    while True:
        await demand.until(wanted=False)
        try:
            async with asyncio.timeout(linger_s):
                await demand.until(wanted=True)
        except TimeoutError:
            return
