"""Intervals of one camera and class: sightings, their pauses, disagreements of two models. Pure."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Self

from msgspec.structs import replace

from schemas.keys import CameraKey
from services.monitor.history.interval_buffer import IntervalBuffer, StoredInterval
from services.monitor.inventory.availability import AvailabilityTracker
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.inventory import Inventory
from services.monitor.inventory.sighting import Change, ChangeKind, Sighting
from services.monitor.liveness import is_recent

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
    """Enters sightings in a buffer."""

    def __init__(self, buffer: IntervalBuffer) -> None:
        self._buffer = buffer

    def take(self, changes: Iterable[Change]) -> None:
        """Take a change of the inventory."""
        for change in changes:
            of = change.sighting
            match change.kind:
                case ChangeKind.APPEARED | ChangeKind.COUNTED:
                    self._buffer.end(Interval, (of.key, of.name), of.since_ns, closest_m=change.closest_m)
                    self._buffer.begin(interval_of(of))
                case ChangeKind.VANISHED | ChangeKind.LOST:
                    self._buffer.end(Interval, (of.key, of.name), of.last_ns, closest_m=change.closest_m)

    def pause(self, sightings: Iterable[Sighting]) -> None:
        """End a silent camera's intervals when they were last seen, until it resumes."""
        self._buffer.note(
            replace(self._kept(of), until_ns=of.last_ns, open=False, closest_m=of.closest_m) for of in sightings
        )

    def resume(self, sightings: Iterable[Sighting]) -> None:
        """Reopen the intervals of a camera that resumed."""
        self._buffer.note(replace(self._kept(of), until_ns=of.last_ns, open=True) for of in sightings)

    def _kept(self, of: Sighting) -> Interval:
        return self._buffer.opened(Interval, (of.key, of.name)) or interval_of(of)


class Disagreement(StoredInterval, frozen=True, gc=False):
    """An interval in which two models counted a class differently: the primary model and the other one."""

    key: CameraKey
    name: str
    count: int
    model: str
    other_count: int
    other_model: str

    @property
    def place(self) -> CameraClass:
        """The place of the disagreement."""
        return (self.key, self.name)

    def is_as(self, before: Self) -> bool:
        """Whether the same models disagree by the same counts."""
        return self._said() == before._said()

    def _said(self) -> tuple[int, str, int, str]:
        return (self.count, self.model, self.other_count, self.other_model)


class Disagreements:
    """Enters disagreements of models in a buffer."""

    def __init__(self, inventory: Inventory, buffer: IntervalBuffer) -> None:
        self._inventory = inventory
        self._buffer = buffer
        self._open: dict[CameraKey, set[str]] = {}

    def note(self, now_ns: int) -> Iterator[None]:
        """Enter the current disagreements, and yield after each camera.

        Cameras at which one model looks by now are looked at once more: their disagreements have ended.
        """
        for key in {*self._inventory.disputed(), *self._open}:
            camera = self._inventory.camera(key)
            if camera is not None:
                self._note(camera, now_ns)
            else:  # it made room for others
                for name in self._open.pop(key, ()):
                    self._buffer.end(Disagreement, (key, name), now_ns)
            yield

    def _note(self, camera: CameraView, now_ns: int) -> None:
        """Enter a camera's disagreements; none while it has no primary model."""
        found = self._found(camera, now_ns) if self._inventory.is_available(camera, now_ns) else {}
        for name in self._open.get(camera.key, set()) - found.keys():
            self._buffer.end(Disagreement, (camera.key, name), now_ns)
        for name, new in found.items():
            old = self._buffer.opened(Disagreement, (camera.key, name))
            if old is None or not new.is_as(old):
                self._buffer.begin(new)
        if found:
            self._open[camera.key] = set(found)
        else:
            self._open.pop(camera.key, None)

    def _found(self, camera: CameraView, now_ns: int) -> Mapping[str, Disagreement]:
        since_ns = now_ns - self._inventory.limits.stale_ns
        primary = "" if camera.primary is None else camera.primary.model
        return {
            name: Disagreement(
                since_ns=now_ns,
                until_ns=now_ns,
                open=True,
                key=camera.key,
                name=name,
                count=ours,
                model=primary,
                other_count=theirs,
                other_model=_model_counting(camera, name, theirs, since_ns),
            )
            for name, (ours, theirs) in camera.disagreements(since_ns).items()
        }


def _model_counting(camera: CameraView, name: str, count: int, since_ns: int) -> str:
    """Return the non-primary model that counts this many objects of a class; empty if none does."""
    return next((view.model for view in camera.others(since_ns) if view.count_of(name) == count), "")


class PauseTracker:
    """Enters silent cameras in a buffer."""

    def __init__(self, inventory: Inventory, sightings: Sightings) -> None:
        self._inventory = inventory
        self._sightings = sightings
        self.begin_anew()

    def begin_anew(self) -> None:
        """Find the silent cameras in a database that has all as available."""
        self._availability = AvailabilityTracker(self._inventory, self._is_recent, available=True)

    def note(self, now_ns: int) -> None:
        """End the intervals of cameras that fell silent, and reopen them when the cameras resume."""
        for camera in self._availability.advance(now_ns):
            if camera.lost:
                continue
            in_view = [sighting for sighting in camera.sightings() if sighting.count]
            if self._is_recent(camera, now_ns):
                self._sightings.resume(in_view)
            else:
                self._sightings.pause(in_view)

    def _is_recent(self, camera: CameraView, now_ns: int) -> bool:
        return is_recent(camera.last_ns, now_ns, self._inventory.limits.stale_ns)
