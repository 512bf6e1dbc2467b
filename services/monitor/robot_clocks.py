"""Offsets of the robots' clocks, and class lists held back until an offset is known. Pure.

Class lists published while the monitor was away arrive all at once, before the robots' clocks have been read. Dated by
arrival, an hour of sightings would be stored at one moment.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from bus.clocks import MAX_DRIFT, ClockOffset, Exchange
from schemas.detections import ClassList
from schemas.header import Header
from schemas.keys import CameraKey, camera_key
from schemas.status import ClockReading
from services.monitor.inventory.sighting import NS

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

    def robot_ns(self, robot: str, ours_ns: int) -> int:
        """Return the reading of a robot's clock when ours shows `ours_ns`; 0 if its offset is unknown."""
        clock = self._clocks.get(robot)
        return 0 if clock is None else self.theirs_ns(robot, clock.clock_id, ours_ns) or 0

    def _is_due(self, robot: str, now_s: float) -> bool:
        clock = self._clocks.get(robot)
        return clock is None or now_s - clock.asked_s >= PERIOD_S


CLOCK_WAIT_NS: Final = 2 * NS
"""Maximum wait for a robot's clock."""

MAX_HELD_BACK: Final = 400_000
"""Maximum number of lists, and classes and spans in them, held back for all cameras; then a camera's are released."""


class Arrival(NamedTuple):
    """A class list that arrived at `received_ns` (epoch) and `now_s` (any steady clock)."""

    seen: ClassList
    now_s: float
    received_ns: int


class ClockHoldback:
    """Holds back kept lists until their robot's clock is known, together with the lists that follow them.

    is_dated: whether it is known how old something of a frame was that arrived at a time (epoch, nanoseconds).
    """

    def __init__(self, is_dated: Callable[[Header, int], bool]) -> None:
        self._is_dated = is_dated
        self._waiting: dict[CameraKey, list[Arrival]] = {}
        self._count = 0

    def arrive(self, arrival: Arrival, *, kept: bool) -> list[Arrival]:
        """Take a list; return the lists to process now, in order. kept: it may have been sent long before."""
        header = arrival.seen.header
        if not self._waiting and not kept:  # the usual case
            return [arrival]
        key = camera_key(header.robot, header.camera)
        if key not in self._waiting and (not kept or self._is_dated(header, arrival.received_ns)):
            return [arrival]
        self._waiting.setdefault(key, []).append(arrival)
        self._count += _parts(arrival)
        return self._taken(key) if self._count > MAX_HELD_BACK else []

    def due(self, now_ns: int) -> Iterator[list[Arrival]]:
        """Yield the lists of each camera that need not wait any longer at `now_ns` (epoch), in order.

        Others may arrive meanwhile, once those that were yielded are taken in.
        """
        for key in list(self._waiting):
            waiting = self._waiting.get(key)
            if waiting and (self._is_known(waiting) or not 0 <= now_ns - waiting[0].received_ns < CLOCK_WAIT_NS):
                yield self._taken(key)

    def _is_known(self, waiting: list[Arrival]) -> bool:
        return self._is_dated(waiting[-1].seen.header, waiting[-1].received_ns)

    def _taken(self, key: CameraKey) -> list[Arrival]:
        """Return a camera's lists; with an unknown clock offset, as if the newest had no transport delay.

        One that would be newer, or too old to be true, is left as it came: the robot's clock was set.
        """
        waiting = self._waiting.pop(key)
        self._count -= sum(map(_parts, waiting))
        if self._is_known(waiting):
            return waiting
        newest = waiting[-1]
        ahead_ns = newest.seen.header.received_ns - newest.received_ns
        older_ns = [ahead_ns - (each.seen.header.received_ns - each.received_ns) for each in waiting]
        return [
            each._replace(received_ns=each.received_ns - older) if 0 <= older <= MAX_LAG_NS else each
            for each, older in zip(waiting, older_ns, strict=True)
        ]


def _parts(arrival: Arrival) -> int:
    return 1 + len(arrival.seen.classes) + len(arrival.seen.spans)
