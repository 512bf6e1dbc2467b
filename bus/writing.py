"""The writing end, the same for the real bus and the fake."""

import threading
from collections.abc import Callable

from bus.api import PublisherCounts
from bus.demand import Demand
from bus.errors import BusClosedError
from bus.pieces import Payload


class MessageWriter:
    """A publisher as its user sees it; `send` takes each message that is fit to be sent."""

    def __init__(self, key: str, demand: Demand, send: Callable[[Payload], None]) -> None:
        self._key = key
        self._demand = demand
        self._send = send
        self._lock = threading.Lock()
        self._ended = False
        self._put = 0
        self._dropped = 0

    @property
    def wanted(self) -> bool:
        """Whether somebody subscribes to the key."""
        return self._demand.wanted

    @property
    def counts(self) -> PublisherCounts:
        """What became of the messages so far."""
        return PublisherCounts(self._put, self._dropped)

    def put(self, payload: Payload) -> None:
        """Hand a message over to be sent."""
        if self._ended:
            raise BusClosedError(f"the publisher of {self._key} is closed")
        if not isinstance(payload, Payload):
            raise TypeError(f"a payload is bytes, bytearray or Pieces, not {type(payload).__name__}")
        self._put += 1
        self._send(payload)

    def count_dropped(self, number: int) -> None:
        """Count messages that were not sent. Any thread."""
        with self._lock:
            self._dropped += number

    def end(self) -> None:
        """Take nothing more."""
        self._ended = True
        self._demand.end()
