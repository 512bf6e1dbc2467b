"""Offsets of the robots' clocks, from readings of their gateways. Pure."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from bus.clocks import MAX_DRIFT, ClockOffset, Exchange
from schemas.clock import ClockReading

PERIOD_S: Final = 10.0
"""Seconds between two readings of a robot's clock."""

MAX_UNCERTAINTY_NS: Final = 100_000_000
"""Offsets with a larger uncertainty are useless for ages, which are shown to a tenth of a second."""

REMEMBERED_S: Final = MAX_UNCERTAINTY_NS / 1e9 / MAX_DRIFT
"""Seconds for which an offset stays accurate enough without a new reading."""

MAX_LAG_NS: Final = 3_600_000_000_000
"""Larger lags are ignored: the gateway's clock was set, or is wrong."""


@dataclass(slots=True)
class _Clock:
    asked_s: float
    clock_id: str = ""
    offset: ClockOffset = field(default_factory=ClockOffset)


class Clocks:
    """Clock offsets by robot, of those online or online until recently."""

    def __init__(self) -> None:
        self._clocks: dict[str, _Clock] = {}

    def due(self, robots: Iterable[str], now_s: float) -> list[str]:
        """Return the online robots whose clock is to be read now, PERIOD_S after the last reading.

        One that went is remembered while its offset is known, so that what it sent in the meantime can be dated.
        """
        online = set(robots)
        self._clocks = {
            robot: clock
            for robot, clock in self._clocks.items()
            if robot in online or now_s - clock.asked_s < REMEMBERED_S
        }
        asked = [robot for robot in sorted(online) if self._is_due(robot, now_s)]
        for robot in asked:
            self._clocks.setdefault(robot, _Clock(now_s)).asked_s = now_s
        return asked

    def take(self, robot: str, reading: ClockReading, *, asked_ns: int, answered_ns: int) -> None:
        """Take a reading with the times of our clock at its request and response."""
        clock = self._clocks.get(robot)
        if clock is None:
            return
        if clock.clock_id != reading.clock_id:
            clock.clock_id, clock.offset = reading.clock_id, ClockOffset()
        clock.offset.add(Exchange(asked_ns, reading.received_ns, reading.sent_ns, answered_ns))

    def theirs_ns(self, robot: str, clock_id: str, ours_ns: int) -> int | None:
        """Return the reading of a robot's clock when ours shows `ours_ns`; None if its offset is unknown."""
        clock = self._clocks.get(robot)
        offset = clock.offset.at(ours_ns) if clock is not None and clock.clock_id == clock_id else None
        if offset is None or offset.uncertainty_ns > MAX_UNCERTAINTY_NS:
            return None
        return ours_ns + offset.offset_ns

    def _is_due(self, robot: str, now_s: float) -> bool:
        clock = self._clocks.get(robot)
        return clock is None or now_s - clock.asked_s >= PERIOD_S
