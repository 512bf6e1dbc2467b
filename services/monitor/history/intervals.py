"""Sightings as intervals: enters inventory changes in the ledger. Pure."""

from collections.abc import Iterable
from typing import Self

from msgspec.structs import replace

from schemas.keys import CameraKey
from services.monitor.history.ledger import Ledger, StoredInterval
from services.monitor.inventory.sighting import Change, ChangeKind, Sighting

CameraClass = tuple[CameraKey, str]
"""A camera and a class in view of it."""


class Interval(StoredInterval, frozen=True, gc=False):
    """A period in which one class was in view of one camera with a constant count.

    first_ns: when the class came into view, with whatever count.
    """

    key: CameraKey
    name: str
    count: int
    score: float
    closest_m: float | None
    first_ns: int
    model: str
    worker: str

    @property
    def place(self) -> CameraClass:
        """The robot, camera and class of the interval."""
        return (self.key, self.name)

    def is_as(self, before: Self) -> bool:
        """Whether the other interval has the same count."""
        return self.count == before.count

    def going_on_from(self, before: Self) -> Self:
        """Return both as one interval."""
        return replace(self, since_ns=before.since_ns, first_ns=min(self.first_ns, before.first_ns))

    def sighting(self) -> Sighting:
        """Return the sighting to restore to the inventory after a restart."""
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


class Sightings:
    """Enters sightings in a ledger."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger

    def take(self, changes: Iterable[Change]) -> None:
        """Take a change of the inventory."""
        for change in changes:
            of = change.sighting
            match change.kind:
                case ChangeKind.APPEARED | ChangeKind.COUNTED:
                    self._ledger.end(Interval, (of.key, of.name), of.since_ns, closest_m=change.closest_m)
                    self._ledger.begin(interval_of(of))
                case ChangeKind.VANISHED | ChangeKind.LOST:
                    self._ledger.end(Interval, (of.key, of.name), of.last_ns, closest_m=change.closest_m)

    def pause(self, sightings: Iterable[Sighting]) -> None:
        """End a silent camera's intervals when they were last seen, until it resumes."""
        self._ledger.note(
            replace(self._kept(of), until_ns=of.last_ns, open=False, closest_m=of.closest_m) for of in sightings
        )

    def resume(self, sightings: Iterable[Sighting]) -> None:
        """Reopen the intervals of a camera that resumed."""
        self._ledger.note(replace(self._kept(of), until_ns=of.last_ns, open=True) for of in sightings)

    def _kept(self, of: Sighting) -> Interval:
        return self._ledger.opened(Interval, (of.key, of.name)) or interval_of(of)
