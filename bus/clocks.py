"""The clock that processes read, and how far another machine's clock is ahead of it."""

import socket
from collections import deque
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Final

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


def clock_id() -> str:
    """Return a name for this machine's system clock, the same for every process and container on it."""
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return socket.gethostname()


MAX_DRIFT: Final = 1e-4
"""How fast two clocks part at most, in seconds a second: twice what a bad quartz is off."""

ROUNDED_NS: Final = 2
"""What whole nanoseconds, theirs and ours, leave uncertain."""

WINDOW: Final = 16
"""How many exchanges are remembered."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """One question and its answer: asked and answered on our clock, received and sent on theirs, nanoseconds."""

    asked_ns: int
    received_ns: int
    sent_ns: int
    answered_ns: int

    @property
    def round_trip_ns(self) -> int:
        """Time spent on the way, both ways together; below zero by what their clock is faster than ours, at most."""
        return (self.answered_ns - self.asked_ns) - (self.sent_ns - self.received_ns)

    @property
    def in_order(self) -> bool:
        """Whether both clocks went forward, theirs no further than ours but for its drift; if not, one was set."""
        drifted_ns = (self.answered_ns - self.asked_ns) * MAX_DRIFT + 1
        return (
            self.asked_ns <= self.answered_ns and self.received_ns <= self.sent_ns and self.round_trip_ns >= -drifted_ns
        )


@dataclass(frozen=True, slots=True)
class Offset:
    """Their clock less ours: within `uncertainty_ns` of `offset_ns`, whatever the ways there and back took."""

    offset_ns: int
    uncertainty_ns: int


class ClockOffset:
    """Follows one other clock. The exchange that says most counts: a short round trip, and not too long ago."""

    def __init__(self) -> None:
        self._exchanges: deque[Exchange] = deque(maxlen=WINDOW)

    def add(self, exchange: Exchange) -> None:
        """Take an exchange; one that contradicts the earlier ones tells that a clock was set, so they are forgotten."""
        if not exchange.in_order:
            return
        earlier, now = self.at(exchange.answered_ns), _seen(exchange, exchange.answered_ns)
        if earlier and abs(earlier.offset_ns - now.offset_ns) > earlier.uncertainty_ns + now.uncertainty_ns:
            self._exchanges.clear()
        self._exchanges.append(exchange)

    def at(self, now_ns: int) -> Offset | None:
        """Return what is known at `now_ns` on our clock, or None before the first exchange."""
        offsets = (_seen(exchange, now_ns) for exchange in self._exchanges)
        return min(offsets, key=lambda offset: offset.uncertainty_ns, default=None)


def _seen(exchange: Exchange, now_ns: int) -> Offset:
    """Return what an exchange says at `now_ns`."""
    ahead_ns = (exchange.received_ns - exchange.asked_ns) + (exchange.sent_ns - exchange.answered_ns)
    drifted_ns = abs(now_ns - exchange.asked_ns) * MAX_DRIFT
    return Offset(ahead_ns // 2, max(0, exchange.round_trip_ns) // 2 + ceil(drifted_ns) + ROUNDED_NS)
