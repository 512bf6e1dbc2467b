"""Intervals, and the ledger that makes them of what changes in the inventory. Pure."""

from collections.abc import Iterable, Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from schemas.keys import CameraKey
from services.monitor.inventory.sighting import Change, ChangeKind, Sighting

MAX_PENDING: Final = 200_000
"""How many intervals wait for a database that is gone; the oldest are given up for newer ones."""

Place = tuple[CameraKey, str]


class Interval(msgspec.Struct, frozen=True, gc=False):
    """As long as one class was in view of one camera with one count. Times are epoch nanoseconds, ours.

    open: it goes on. first_ns: when the class came into view, with whatever count.
    """

    key: CameraKey
    name: str
    since_ns: int
    until_ns: int
    open: bool
    count: int
    score: float
    closest_m: float | None
    first_ns: int
    model: str
    worker: str

    @property
    def place(self) -> Place:
        """Whose interval it is."""
        return (self.key, self.name)

    def sighting(self) -> Sighting:
        """Return what the inventory is told of it after a restart."""
        return Sighting(
            key=self.key,
            name=self.name,
            count=self.count if self.open else 0,
            score=self.score,
            first_ns=self.first_ns,
            since_ns=self.since_ns,
            last_ns=self.until_ns,
            model=self.model,
            worker=self.worker,
            closest_m=self.closest_m,
        )


def interval_of(sighting: Sighting) -> Interval:
    """Return the open interval of a sighting."""
    return Interval(
        key=sighting.key,
        name=sighting.name,
        since_ns=sighting.since_ns,
        until_ns=max(sighting.since_ns, sighting.last_ns),
        open=True,
        count=sighting.count,
        score=sighting.score,
        closest_m=sighting.closest_m,
        first_ns=sighting.first_ns,
        model=sighting.model,
        worker=sighting.worker,
    )


class Ledger:
    """What is open, and what is to be written. lost: intervals given up because too many waited."""

    def __init__(self) -> None:
        self._open: dict[Place, Interval] = {}
        self._pending: dict[tuple[Place, int], Interval] = {}
        self.lost = 0

    def __len__(self) -> int:
        return len(self._pending)

    def take(self, changes: Iterable[Change]) -> None:
        """Take what changed in the inventory."""
        for change in changes:
            of = change.sighting
            match change.kind:
                case ChangeKind.APPEARED | ChangeKind.COUNTED:
                    self._close((of.key, of.name), of.since_ns, change.closest_m)
                    self._begin(interval_of(of))
                case ChangeKind.VANISHED | ChangeKind.LOST:
                    self._close((of.key, of.name), of.last_ns, change.closest_m)

    def pause(self, sightings: Iterable[Sighting]) -> None:
        """Have what a silent camera had in view end when it was last seen, until it is resumed."""
        self._put(replace(self._kept(of), until_ns=of.last_ns, open=False, closest_m=of.closest_m) for of in sightings)

    def resume(self, sightings: Iterable[Sighting]) -> None:
        """Have it go on."""
        self._put(replace(self._kept(of), until_ns=of.last_ns, open=True) for of in sightings)

    def adopt(self, stored: Iterable[Interval]) -> None:
        """Go on with open intervals of the database, whose sightings the inventory was given back."""
        self._open.update((interval.place, interval) for interval in stored if interval.open)

    def merge(self, stored: Iterable[Interval], heartbeat_ns: int, now_ns: int, gap_ns: int) -> None:
        """Begin to write where another monitor, or this one, stopped at `heartbeat_ns`.

        What is open there and here with the same count is one interval if the gap is no longer than `gap_ns`; what is
        open there alone ended at the heartbeat.
        """
        goes_on = now_ns - heartbeat_ns <= gap_ns
        for old in stored:
            ours = self._open.get(old.place)
            if (old.place, old.since_ns) in self._pending:
                continue
            if ours is not None and (ours.since_ns == old.since_ns or (goes_on and ours.count == old.count)):
                self._pending.pop((ours.place, ours.since_ns), None)
                self._open[old.place] = replace(ours, since_ns=old.since_ns, first_ns=min(old.first_ns, ours.first_ns))
            else:
                until_ns = max(old.until_ns, heartbeat_ns)
                if ours is not None:
                    until_ns = max(old.since_ns, min(until_ns, ours.since_ns))
                self._put([replace(old, until_ns=until_ns, open=False)])
        self._put(self._open.values())

    def pending(self, at_most: int) -> Sequence[Interval]:
        """Return the oldest of what is to be written."""
        return [interval for interval, _ in zip(self._pending.values(), range(at_most), strict=False)]

    def written(self, intervals: Iterable[Interval]) -> None:
        """Forget what was written, unless it changed meanwhile."""
        for interval in intervals:
            if self._pending.get((interval.place, interval.since_ns)) is interval:
                del self._pending[interval.place, interval.since_ns]

    def forget_pending(self) -> None:
        """Forget what is to be written: another monitor writes it."""
        self._pending.clear()

    def _begin(self, interval: Interval) -> None:
        self._open[interval.place] = interval
        self._put([interval])

    def _close(self, place: Place, until_ns: int, closest_m: float | None) -> None:
        old = self._open.pop(place, None)
        if old is not None:
            ended = replace(old, until_ns=max(old.since_ns, until_ns), open=False, closest_m=closest_m)
            self._put([ended])

    def _kept(self, of: Sighting) -> Interval:
        return self._open.get((of.key, of.name)) or interval_of(of)

    def _put(self, intervals: Iterable[Interval]) -> None:
        for interval in intervals:
            at = (interval.place, interval.since_ns)
            if at not in self._pending and len(self._pending) >= MAX_PENDING:
                del self._pending[next(iter(self._pending))]
                self.lost += 1
            self._pending[at] = interval
