"""The machine's clock, and the offset of another machine's clock."""

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
"""Fastest drift between two clocks, in seconds a second: twice that of a poor quartz."""

ROUNDED_NS: Final = 2
"""Uncertainty from rounding both clocks to whole nanoseconds."""

WINDOW: Final = 16
"""Exchanges that are remembered."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """One request and its answer, in ns: asked and answered on our clock, received and sent on theirs."""

    asked_ns: int
    received_ns: int
    sent_ns: int
    answered_ns: int

    @property
    def round_trip_ns(self) -> int:
        """Travel time of both ways together; negative only by as much as their clock runs faster than ours."""
        return (self.answered_ns - self.asked_ns) - (self.sent_ns - self.received_ns)

    @property
    def in_order(self) -> bool:
        """Whether both clocks advanced, theirs by no more than ours plus drift; if not, one of them was set."""
        drifted_ns = (self.answered_ns - self.asked_ns) * MAX_DRIFT + 1
        return (
            self.asked_ns <= self.answered_ns and self.received_ns <= self.sent_ns and self.round_trip_ns >= -drifted_ns
        )


@dataclass(frozen=True, slots=True)
class Offset:
    """Their clock minus ours: within `uncertainty_ns` of `offset_ns`, however asymmetric the travel times."""

    offset_ns: int
    uncertainty_ns: int


class ClockOffset:
    """Estimates the offset of one other clock from the best exchange: a short round trip, not too long ago."""

    def __init__(self) -> None:
        self._exchanges: deque[Exchange] = deque(maxlen=WINDOW)

    def add(self, exchange: Exchange) -> None:
        """Add an exchange; if it contradicts the earlier ones, a clock was set, and they are forgotten."""
        if not exchange.in_order:
            return
        earlier, now = self.at(exchange.answered_ns), _seen(exchange, exchange.answered_ns)
        if earlier and abs(earlier.offset_ns - now.offset_ns) > earlier.uncertainty_ns + now.uncertainty_ns:
            self._exchanges.clear()
        self._exchanges.append(exchange)

    def at(self, now_ns: int) -> Offset | None:
        """Return the offset at `now_ns` on our clock, or None before the first exchange."""
        offsets = (_seen(exchange, now_ns) for exchange in self._exchanges)
        return min(offsets, key=lambda offset: offset.uncertainty_ns, default=None)


def _seen(exchange: Exchange, now_ns: int) -> Offset:
    """Return the offset at `now_ns` according to one exchange."""
    ahead_ns = (exchange.received_ns - exchange.asked_ns) + (exchange.sent_ns - exchange.answered_ns)
    drifted_ns = abs(now_ns - exchange.asked_ns) * MAX_DRIFT
    return Offset(ahead_ns // 2, max(0, exchange.round_trip_ns) // 2 + ceil(drifted_ns) + ROUNDED_NS)
