"""Samples of many publishers, fetched together: one by one each would wait until the event loop's thread lets it in."""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback, FifoChannel

from bus.session.panics import panics_are_errors

ROOM: Final = 16_384
"""Samples that wait to be fetched; then the link waits."""

AT_ONCE: Final = 1_000

TOGETHER: Final = 100
"""So many are worth waiting for: each costs less than it does where fewer come together."""

SHORTEST_S: Final = 0.005
LONGEST_S: Final = 0.02
"""How long what comes after a batch waits for others at least, and at most."""

DELIVERED_S: Final = 0.05
"""After so long what had come should be delivered: longer than it waits, so that a busy interpreter gets to it, too."""

STOP_GRACE_S: Final = 0.2
"""Longest wait for a batch that is being delivered when its subscriber is undeclared."""

_log: Final = logging.getLogger(__name__)


def taking(
    declare: Callable[[Any], Any], deliver: Callable[[Sequence[zenoh.Sample]], None], *, together: bool
) -> ExitStack:
    """Declare a subscriber by its handler, and have its samples delivered in batches or each as it comes.

    Leaving what is returned undeclares it: one with a callback lives on when it is only forgotten.
    """
    declared = ExitStack()
    if together:
        subscriber = declare(FifoChannel(ROOM))
        declared.callback(Gathering(subscriber.handler, deliver).join, STOP_GRACE_S)
    else:
        subscriber = declare(Callback(lambda sample: deliver([sample]), indirect=False))
    declared.callback(subscriber.undeclare)
    return declared


class Gathering:
    """Fetches what a channel receives, until the channel is closed, on a thread of its own.

    deliver: is given the samples of a batch, in order.
    """

    def __init__(self, channel: Any, deliver: Callable[[Sequence[zenoh.Sample]], None]) -> None:
        self._channel = channel
        self._deliver = deliver
        self._thread = threading.Thread(target=self._run, name="bus-gathering", daemon=True)
        self._thread.start()

    def join(self, grace_s: float) -> None:
        """Wait for the end, which comes by itself once the channel is closed; not for long."""
        self._thread.join(grace_s)

    def _run(self) -> None:
        wait_s = SHORTEST_S
        while number := self._fetch():
            wait_s = next_wait_s(wait_s, number)
            time.sleep(wait_s)

    def _fetch(self) -> int:
        """Deliver what waits, once something does; return how many, 0 if nothing comes any more."""
        batch = self._next()  # not kept until the next one, which may be long in coming: it holds shared memory
        if batch:
            try:
                with panics_are_errors():
                    self._deliver(batch)
            except Exception:  # noqa: BLE001 - whatever is wrong with one message, the link waits until others are fetched
                _log.exception("not all of %d messages were delivered", len(batch))
        return len(batch)

    def _next(self) -> list[zenoh.Sample]:
        """Wait for samples; there are none when none come any more."""
        batch: list[zenoh.Sample] = []
        try:
            sample = self._channel.recv()
            while sample is not None:
                batch.append(sample)
                sample = self._channel.try_recv() if len(batch) < AT_ONCE else None
        except zenoh.ZError:  # it is closed
            pass
        return batch


def next_wait_s(before_s: float, number: int) -> float:
    """Return how long to wait for about TOGETHER to come, after `number` came in about `before_s`."""
    return min(LONGEST_S, max(SHORTEST_S, before_s * TOGETHER / number))
