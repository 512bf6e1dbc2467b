"""Holds back class lists until the clock of their robot is known. Pure.

What was published while the monitor was away comes all at once, and before robots have said what their clocks show.
Taken for what is in view on arrival, it would file an hour's coming and going under one moment.
"""

from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from schemas.detections import ClassList
from schemas.header import Header
from schemas.keys import CameraKey, camera_key
from services.monitor.clocks import MAX_LAG_NS
from services.monitor.inventory.sighting import NS

PATIENCE_NS: Final = 2 * NS
"""Maximum wait for a robot's clock."""

MOST_WAITING: Final = 100_000
"""Maximum number of lists held back for all cameras; at the limit a camera's lists are released."""


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
        self._count += 1
        return self._taken(key) if self._count > MOST_WAITING else []

    def due(self, now_ns: int) -> Iterator[list[Arrival]]:
        """Yield the lists of each camera that need not wait any longer at `now_ns` (epoch), in order.

        Others may arrive meanwhile, once those that were yielded are taken in.
        """
        for key in list(self._waiting):
            waiting = self._waiting.get(key)
            if waiting and (self._is_known(waiting) or not 0 <= now_ns - waiting[0].received_ns < PATIENCE_NS):
                yield self._taken(key)

    def _is_known(self, waiting: list[Arrival]) -> bool:
        return self._is_dated(waiting[-1].seen.header, waiting[-1].received_ns)

    def _taken(self, key: CameraKey) -> list[Arrival]:
        """Return a camera's lists; with an unknown clock offset, as if the newest had no transport delay.

        One that would be newer, or too old to be true, is left as it came: the robot's clock was set.
        """
        waiting = self._waiting.pop(key)
        self._count -= len(waiting)
        if self._is_known(waiting):
            return waiting
        newest = waiting[-1]
        ahead_ns = newest.seen.header.received_ns - newest.received_ns
        older_ns = [ahead_ns - (each.seen.header.received_ns - each.received_ns) for each in waiting]
        return [
            each._replace(received_ns=each.received_ns - older) if 0 <= older <= MAX_LAG_NS else each
            for each, older in zip(waiting, older_ns, strict=True)
        ]
