"""Fetches samples of many publishers in batches: one by one, each would wait for the interpreter lock."""

import atexit
import logging
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from typing import Any, Final
from weakref import WeakSet

import zenoh
from zenoh.handlers import Callback, FifoChannel

from bus.errors import BusError
from bus.session.panics import panics_are_errors

CHANNEL_SAMPLES: Final = 2_048
"""Capacity of the channel, in samples; when it is full, the link waits.

A sample holds the whole batch that it came in until it is fetched, 64 KiB: with eight times the room, small messages of
a flood took 100 MB here.
"""

SAMPLE_ROOM_BYTES: Final = 512 << 10
"""Of a subscription whose waiting samples have a limit in bytes, the channel has one place for so many of them."""

LEAST_ROOM: Final = 256

MAX_BATCH_SAMPLES: Final = 1_000

BYTES_AT_ONCE: Final = 8 << 20
"""Most bytes of payloads in a batch, but for its last sample."""

GOOD_BATCH_SAMPLES: Final = 100
"""Size of a batch that is worth waiting for: larger batches cost less per sample."""

SHORTEST_S: Final = 0.005
LONGEST_S: Final = 0.02
"""Shortest and longest time that the samples after a batch wait for others."""

DELIVERED_S: Final = 0.05
"""Samples should be delivered within this time: longer than LONGEST_S, with a margin for a busy interpreter."""

STOP_GRACE_S: Final = 0.2
"""Longest wait for a batch that is being delivered when its subscriber is undeclared."""

_OPEN: Final[WeakSet[ExitStack]] = WeakSet()

_log: Final = logging.getLogger(__name__)


def taking(
    declare: Callable[[Any], Any],
    deliver: Callable[[Sequence[zenoh.Sample]], None],
    *,
    together: bool,
    most_bytes: int = sys.maxsize,
) -> ExitStack:
    """Declare a subscriber and deliver its samples, in batches or one by one.

    most_bytes: of all samples that wait where they are delivered to; beside them, few large ones wait here.

    Closing the returned stack undeclares it; dropping the reference alone does not end one with a callback.
    """
    declared = ExitStack()
    if together:
        room = min(CHANNEL_SAMPLES, max(LEAST_ROOM, most_bytes // SAMPLE_ROOM_BYTES))
        subscriber = declare(FifoChannel(room))
        declared.callback(Gathering(subscriber.handler, deliver, room).join, STOP_GRACE_S)
        _OPEN.add(declared)
    else:
        subscriber = declare(Callback(lambda sample: deliver([sample]), indirect=False))
    declared.callback(subscriber.undeclare)
    return declared


@atexit.register
def _close_all() -> None:
    """End the threads of a process that ends without closing its bus: in Zenoh's code, they would abort it."""
    for declared in list(_OPEN):
        with suppress(zenoh.ZError, BusError), panics_are_errors():
            declared.close()


class Gathering:
    """Fetches samples from a channel on a thread of its own, until the channel is closed.

    deliver: is given the samples of a batch, in order. room: of the channel. size: the bytes of a sample.
    """

    def __init__(
        self,
        channel: Any,
        deliver: Callable[[Sequence[zenoh.Sample]], None],
        room: int = CHANNEL_SAMPLES,
        size: Callable[[Any], int] = lambda sample: len(sample.payload),
    ) -> None:
        self._channel = channel
        self._room = room
        self._size = size
        self._is_behind = False
        self._deliver = deliver
        self._thread = threading.Thread(target=self._run, name="bus-gathering", daemon=True)
        self._thread.start()

    def join(self, grace_s: float) -> None:
        """Wait briefly for the thread, which ends once the channel is closed."""
        self._thread.join(grace_s)

    def _run(self) -> None:
        wait_s = SHORTEST_S
        while number := self._fetch():
            wait_s = next_wait_s(wait_s, number)
            if not self._is_behind:
                time.sleep(wait_s)

    def _fetch(self) -> int:
        """Wait for samples and deliver them; return their number, 0 once the channel is closed."""
        batch = self._next()  # not kept while waiting for the next one: it holds shared memory
        if batch:
            try:
                with panics_are_errors():
                    self._deliver(batch)
            except Exception:  # noqa: BLE001 - whatever is wrong with one message, the link waits until others are fetched
                _log.exception("not all of %d messages were delivered", len(batch))
        return len(batch)

    def _next(self) -> list[zenoh.Sample]:
        """Wait for samples and return them; none once the channel is closed."""
        batch: list[zenoh.Sample] = []
        left = BYTES_AT_ONCE
        try:
            sample = self._channel.recv()
            while sample is not None:
                batch.append(sample)
                left -= self._size(sample)
                sample = self._channel.try_recv() if len(batch) < MAX_BATCH_SAMPLES and left > 0 else None
        except zenoh.ZError:  # the channel is closed
            pass
        self._is_behind = left <= 0 or len(batch) >= self._room
        return batch


def next_wait_s(before_s: float, number: int) -> float:
    """Return the seconds to wait for about GOOD_BATCH_SAMPLES samples, after `number` came in about `before_s`."""
    return min(LONGEST_S, max(SHORTEST_S, before_s * GOOD_BATCH_SAMPLES / number))
