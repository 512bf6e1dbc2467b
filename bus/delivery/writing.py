"""The publisher's writing side, the same for the real bus and the fake."""

import logging
import threading
import time
from collections.abc import Callable, Hashable
from typing import Final, Protocol

from bus.api import MAX_PAYLOAD_BYTES, PublisherCounts
from bus.delivery.mailbox import PerKey
from bus.delivery.split_payload import Payload
from bus.demand import Demand
from bus.errors import BusClosedError, BusError


class MessageWriter:
    """A publisher as its user sees it; `send` takes each valid message."""

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
        """Counts of the messages so far."""
        return PublisherCounts(self._put, self._dropped)

    def put(self, payload: Payload) -> None:
        """Queue a message for sending."""
        if self._ended:
            raise BusClosedError(f"the publisher of {self._key} is closed")
        if not isinstance(payload, Payload):
            raise TypeError(f"a payload is bytes, bytearray or Pieces, not {type(payload).__name__}")
        if len(payload) > MAX_PAYLOAD_BYTES:
            raise BusError(f"{self._key}: a message of {len(payload)} bytes, at most {MAX_PAYLOAD_BYTES} are carried")
        self._put += 1
        self._send(payload)

    def count_dropped(self, number: int) -> None:
        """Count messages that were not sent. Any thread."""
        with self._lock:
            self._dropped += number

    def end(self) -> None:
        """Refuse further messages."""
        self._ended = True
        self._demand.end()


QUICK_S: Final = 0.005
"""A write that takes longer counts as slow: it has waited for a link."""

QUICK_WRITES: Final = 10
"""Successive quick writes after which a publisher's next ones are made at once."""

_log: Final = logging.getLogger(__name__)


class Writer(Hashable, Protocol):
    """One publisher as its lane sees it."""

    @property
    def kept(self) -> int:
        """Smallest queue of the publisher, in messages."""

    def write(self, payload: Payload) -> None:
        """Send a message; may take a while."""

    def count_dropped(self, number: int) -> None:
        """Count messages that were not sent."""


class Lane:
    """Bounded queues of many publishers, served in turn by one thread.

    A publisher's messages wait until it is admitted, which is when there is a link that takes them. Handing a message
    to the thread costs more than sending it: while a publisher's writes take less than QUICK_S, they are made at once.
    The first one that is not has all publishers write on the thread again: they share their links, and whoever offers
    waits once for all of them.
    """

    def __init__(self, name: str, depth: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._name = name
        self._clock = clock
        self._lock = threading.Lock()
        self._queued = threading.Condition(self._lock)
        self._written = threading.Condition(self._lock)
        self._retiring = 0
        self._held: PerKey[Writer, Payload] = PerKey(depth)
        self._ready: PerKey[Writer, Payload] = PerKey(depth)
        self._quick_writes: dict[Writer, int] = {}
        self._writing: set[Writer] = set()
        self._thread: threading.Thread | None = None
        self._stopping = False

    def offer(self, writer: Writer, payload: Payload, depth: int = 0) -> None:
        """Send or queue a message; one that meets a slow link on the direct path blocks for as long as its write.

        depth: how many of the writer's messages may wait with this one, if that is more than of others.
        """
        with self._lock:
            at_once = self._is_quick(writer)
            if at_once:
                self._writing.add(writer)
            dropped = 0 if at_once else self._queue(writer, payload, max(depth, writer.kept))
        if at_once and not self._write(writer, payload):
            self._write_none_at_once()
        elif dropped:
            writer.count_dropped(dropped)

    def _is_quick(self, writer: Writer) -> bool:
        quick = self._quick_writes.get(writer, 0) >= QUICK_WRITES
        return quick and writer not in self._ready and writer not in self._writing

    def _write_none_at_once(self) -> None:
        with self._lock:
            self._quick_writes = dict.fromkeys(self._quick_writes, 0)

    def _queue(self, writer: Writer, payload: Payload, depth: int) -> int:
        if writer not in self._quick_writes:
            return self._held.offer(writer, payload, depth)
        self._queued.notify()
        return self._ready.offer(writer, payload, depth)

    def admit(self, writer: Writer) -> None:
        """Start sending a publisher's messages, including those that it has queued."""
        with self._lock:
            self._quick_writes[writer] = 0
            held = self._held.discard(writer)
            for payload in held:
                self._ready.offer(writer, payload, len(held))
            self._queued.notify()
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name=f"bus-{self._name}", daemon=True)
                self._thread.start()

    def retire(self, writer: Writer, grace_s: float) -> None:
        """Wait up to `grace_s` for a publisher's queue to be written, drop the rest, and stop writing to it."""
        with self._lock:
            if writer in self._quick_writes:
                self._retiring += 1
                self._written.wait_for(lambda: writer not in self._ready and writer not in self._writing, grace_s)
                self._retiring -= 1
            self._quick_writes.pop(writer, None)
            rest = len(self._held.discard(writer)) + len(self._ready.discard(writer))
        if rest:
            writer.count_dropped(rest)

    def stop(self, grace_s: float) -> None:
        """End the thread; not to be called from it."""
        with self._lock:
            self._stopping = True
            self._queued.notify()
        if self._thread is not None:
            self._thread.join(grace_s)

    def _run(self) -> None:
        while (writing := self._next()) is not None:
            self._write(*writing)

    def _next(self) -> tuple[Writer, Payload] | None:
        with self._lock:
            while not self._stopping:
                taken = self._ready.take()
                if taken is not None:
                    self._writing.add(taken.key)
                    return taken.key, taken.item
                self._queued.wait()
            return None

    def _write(self, writer: Writer, payload: Payload) -> bool:
        """Write a message; return whether the write was quick."""
        began = self._clock()
        try:
            writer.write(payload)
        except Exception as error:  # noqa: BLE001 - whatever one message meets, the lane serves the others
            writer.count_dropped(1)
            _log.debug("a message was not sent: %s", error)
        quick = self._clock() - began < QUICK_S
        with self._lock:
            self._writing.discard(writer)
            if writer in self._quick_writes:
                self._quick_writes[writer] = self._quick_writes[writer] + 1 if quick else 0
            if self._retiring:
                self._written.notify_all()
        return quick
