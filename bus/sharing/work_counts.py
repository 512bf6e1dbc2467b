"""Tallies of a worker's cameras: work done, and drops by reason. Pure."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Generic, TypeVar

from schemas.header import MAX_COUNT
from schemas.keys import CameraKey
from schemas.status import MAX_STREAMS, CameraLoad


class Tally:
    """Counts a camera's results, and its drops by reason."""

    def __init__(self, camera: CameraKey) -> None:
        self.camera = camera
        self.done = 0
        self.dropped: Counter[str] = Counter()

    def add(self, what: str, dropped: Counter[str]) -> None:
        """Move the drops of one kind of thing, by reason, into this tally."""
        for reason, count in dropped.items():
            self.dropped[f"{what}: {reason}"] += count
        dropped.clear()

    def load(self, *, serving: bool, budget_hz: float | None = None) -> CameraLoad:
        """Return the counts as a message, capped to its range."""
        return CameraLoad(
            robot=self.camera.robot,
            camera=self.camera.camera,
            inferred=min(self.done, MAX_COUNT),
            dropped={reason: min(count, MAX_COUNT) for reason, count in self.dropped.items() if count},
            serving=serving,
            budget_hz=budget_hz,
        )


T = TypeVar("T", bound=Tally)


class Tallies(Generic[T]):
    """Tallies of the cameras that a worker serves now or served last.

    new: makes one. most: how many there are; only cameras that are being served may be more. kept: they, those that
    began to be served last at the end.
    """

    def __init__(self, new: Callable[[CameraKey], T], most: int = MAX_STREAMS) -> None:
        self._new = new
        self._most = most
        self.kept: dict[CameraKey, T] = {}
        self._served: set[CameraKey] = set()

    @contextmanager
    def serving(self, camera: CameraKey) -> Iterator[T]:
        """Yield a camera's tally while it is served; it continues from before unless too many others came since."""
        tally = self.kept.pop(camera) if camera in self.kept else self._new(camera)
        self.kept[camera] = tally
        self._served.add(camera)
        unserved = [each for each in self.kept if each not in self._served]
        for each in unserved[: max(0, len(self.kept) - self._most)]:
            del self.kept[each]
        try:
            yield tally
        finally:
            self._served.discard(camera)

    def loads(self, budgets_hz: Mapping[CameraKey, float | None] | None = None) -> list[CameraLoad]:
        """Return each camera's counts as a message; if a status cannot hold all, those served now or last.

        budgets_hz: how often at most a worker asked for each camera's frames, where it did.
        """
        by_use = sorted(self.kept.items(), key=lambda each: each[0] in self._served)
        budgets_hz = budgets_hz or {}
        return [
            tally.load(serving=camera in self._served, budget_hz=budgets_hz.get(camera))
            for camera, tally in by_use[-MAX_STREAMS:]
        ]
