"""Disagreements between two models on one camera. Pure."""

from collections.abc import Iterator, Mapping
from typing import Self

from schemas.keys import CameraKey
from services.monitor.history.intervals import CameraClass
from services.monitor.history.ledger import Ledger, StoredInterval
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.inventory import Inventory


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
    """Enters disagreements of models in a ledger."""

    def __init__(self, inventory: Inventory, ledger: Ledger) -> None:
        self._inventory = inventory
        self._ledger = ledger
        self._open: dict[CameraKey, set[str]] = {}

    def note(self, now_ns: int) -> Iterator[None]:
        """Enter the current disagreements, and yield after each camera.

        Cameras at which one model looks by now are looked at once more: what models disagreed about has ended there.
        """
        for key in {*self._inventory.disputed(), *self._open}:
            camera = self._inventory.camera(key)
            if camera is not None:
                self._note(camera, now_ns)
            yield

    def _note(self, camera: CameraView, now_ns: int) -> None:
        """Enter a camera's disagreements; none while it has no primary model."""
        found = self._found(camera, now_ns) if self._inventory.speaks(camera, now_ns) else {}
        for name in self._open.get(camera.key, set()) - found.keys():
            self._ledger.end(Disagreement, (camera.key, name), now_ns)
        for name, new in found.items():
            old = self._ledger.opened(Disagreement, (camera.key, name))
            if old is None or not new.is_as(old):
                self._ledger.begin(new)
        if found:
            self._open[camera.key] = set(found)
        else:
            self._open.pop(camera.key, None)

    def _found(self, camera: CameraView, now_ns: int) -> Mapping[str, Disagreement]:
        since_ns = now_ns - self._inventory.limits.stale_ns
        speaker = "" if camera.speaker is None else camera.speaker.model
        return {
            name: Disagreement(
                since_ns=now_ns,
                until_ns=now_ns,
                open=True,
                key=camera.key,
                name=name,
                count=ours,
                model=speaker,
                other_count=theirs,
                other_model=_who_counts(camera, name, theirs, since_ns),
            )
            for name, (ours, theirs) in camera.disagreements(since_ns).items()
        }


def _who_counts(camera: CameraView, name: str, count: int, since_ns: int) -> str:
    """Return the model, other than the one that speaks, that counts so many of a class."""
    return next((view.model for view in camera.others(since_ns) if view.count_of(name) == count), "")
