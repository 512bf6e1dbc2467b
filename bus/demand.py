"""Whether a publisher is wanted, told by any thread and acted upon on the event loop."""

import threading
from asyncio import AbstractEventLoop
from collections.abc import Callable

from bus.inbox import call_soon


class Demand:
    """The newest word on a publisher's demand; changes in between are merged."""

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
        """Tell the demand; an `initial` word loses against anything heard before. Any thread."""
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
        """Take it that nobody wants anything until the next word, which may be an initial one. Any thread."""
        self.offer(wanted=False)
        with self._lock:
            self._heard = False

    def end(self) -> None:
        """Tell nothing more. Event loop only."""
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
