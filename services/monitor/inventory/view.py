"""The view of one model on one camera. Pure."""

import sys
from collections.abc import Iterable, Mapping
from collections.abc import Set as AbstractSet
from itertools import islice
from typing import Final

from schemas import worker_keys
from schemas.detections import ClassCount, ClassList
from schemas.header import FrameOrder
from schemas.keys import CameraKey
from services.monitor.inventory.debounce import Debounce, DebouncedCount
from services.monitor.inventory.sighting import NS, Sighting

Vocabularies = Mapping[tuple[str, str], AbstractSet[str]]
"""The classes that workers say they report, by service and worker."""

MAX_CLASS_BYTES: Final = 128 << 20
"""Most bytes, about, that the classes of all cameras take; known ones go on beyond that, new ones are left out."""

CLASS_BYTES: Final = 400
"""Bytes that a class in a view takes beside its name."""

MAX_CLASSES: Final = 64
"""How many classes of one camera are remembered; those not in view longest make room."""


MOST_LISTED: Final = 2 * MAX_CLASSES
"""How many classes of a list are looked at: the first ones."""

REPLAY_NS: Final = NS
"""Time after a restart within which the lists kept by publishers arrive: many were taken before it."""


class ClassRoom:
    """The bytes that the classes of all cameras take, at most: forgotten classes count until the next `recount`."""

    def __init__(self) -> None:
        self.bytes = 0

    def take(self, name: str) -> bool:
        """Note a new class of a view; return whether there is room for it."""
        fits = self.bytes < MAX_CLASS_BYTES
        if fits:
            self.bytes += bytes_of(name)
        return fits

    def recount(self, views: Iterable["ModelView"]) -> None:
        """Count what is there."""
        self.bytes = sum(bytes_of(name) for view in views for name in view.classes)


def bytes_of(name: str) -> int:
    """Return the bytes that a class takes, about."""
    return CLASS_BYTES + sys.getsizeof(name)


class Tracked:
    """One class in a view: its settled count, and its current or last sighting.

    closest_m: the nearest that any came since the count last moved; before_m: the same until then. came: whether it
    came into view when the count last moved. listed: the number of the view's newest list that named it.
    """

    __slots__ = (
        "before_m",
        "came",
        "closest_m",
        "count",
        "first_ns",
        "last_ns",
        "listed",
        "nearest_m",
        "nearest_ns",
        "score",
        "worker",
    )

    def __init__(self, count: int = 0) -> None:
        self.count = DebouncedCount(count)
        self.score = 0.0
        self.first_ns = 0
        self.last_ns = 0
        self.worker = ""
        self.nearest_m: float | None = None
        self.nearest_ns = 0
        self.closest_m: float | None = None
        self.before_m: float | None = None
        self.came = False
        self.listed = 0

    def advance(self, seen: ClassCount, worker: str, at_ns: int, debounce: Debounce) -> bool:
        """Take the class's count of a list; return whether the settled count changed."""
        if seen.count:
            self.score, self.worker, self.last_ns = seen.score, worker, at_ns
        was_gone = self.count.count == 0
        if not self.count.advance(seen.count, at_ns, debounce):
            return False
        if was_gone:
            self.first_ns = self.count.since_ns
        self.move(came=was_gone)
        return True

    def move(self, *, came: bool) -> None:
        """Note that the count changed, and reset the nearest distance."""
        self.came = came
        self.before_m, self.closest_m = self.closest_m, None

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now: the clock was set back."""
        self.first_ns, self.last_ns = min(self.first_ns, now_ns), min(self.last_ns, now_ns)
        self.nearest_ns = min(self.nearest_ns, now_ns)
        self.count.since_ns = min(self.count.since_ns, now_ns)

    def measure(self, nearest_m: float | None, at_ns: int) -> None:
        """Note the nearest distance."""
        self.nearest_m, self.nearest_ns = nearest_m, at_ns
        if nearest_m is not None:
            self.closest_m = nearest_m if self.closest_m is None else min(self.closest_m, nearest_m)

    def nearest_since(self, since_ns: int) -> float | None:
        """Return the nearest distance in view; one older than `since_ns` is unknown."""
        return self.nearest_m if self.count.count and self.nearest_ns >= since_ns else None

    def sighting(self, key: CameraKey, name: str, model: str, nearest_since_ns: int = 0) -> Sighting:
        """Return the current sighting; a distance older than `nearest_since_ns` is unknown."""
        return Sighting(
            key=key,
            name=name,
            count=self.count.count,
            score=self.score,
            first_ns=self.first_ns,
            since_ns=self.count.since_ns,
            last_ns=self.last_ns,
            model=model,
            worker=self.worker,
            nearest_m=self.nearest_since(nearest_since_ns),
            closest_m=self.closest_m,
        )


class ModelView:
    """The classes that one model has in view.

    began_ns: since when it looks without a gap; of one that was restored, a moment later. lists: how many were taken
    since then; settled: enough to tell what is not in view. worker: who sent the newest one.
    """

    __slots__ = (
        "_listed_ns",
        "_room",
        "began_ns",
        "classes",
        "last_ns",
        "lists",
        "model",
        "order",
        "service",
        "settled",
        "worker",
    )

    def __init__(
        self, model: str, began_ns: int, service: str = worker_keys.DETECTOR, *, room: ClassRoom | None = None
    ) -> None:
        self._room = room
        self.model = model
        self.service = service
        self.worker = ""
        self.began_ns = began_ns
        self.last_ns = began_ns
        self.classes: dict[str, Tracked] = {}
        self.order = FrameOrder()
        self.lists = 0
        self.settled = False
        self._listed_ns = began_ns

    def begin_anew(self, at_ns: int) -> None:
        """Start over after a gap: the earlier view is no longer known to hold."""
        self.began_ns, self.lists, self.settled = at_ns, 0, False
        for tracked in self.classes.values():
            tracked.count, tracked.listed = DebouncedCount(), 0

    def set_back(self, now_ns: int) -> None:
        """Cap all arrival times at now: the clock was set back."""
        self.began_ns, self.last_ns = min(self.began_ns, now_ns), min(self.last_ns, now_ns)
        self._listed_ns = min(self._listed_ns, now_ns)
        self.order.set_back(now_ns)
        for tracked in self.classes.values():
            tracked.set_back(now_ns)

    def take_over(self, moved: Iterable[str], since_ns: int) -> None:
        """Become the primary model since then, replacing one that reported otherwise about these classes until then."""
        self.began_ns = max(self.began_ns, since_ns)
        for tracked in (self.classes[name] for name in moved):
            tracked.first_ns = max(tracked.first_ns, since_ns)
            tracked.count.since_ns = max(tracked.count.since_ns, since_ns)

    def advance(self, seen: ClassList, at_ns: int, debounce: Debounce) -> list[str]:
        """Take a new class list; return the classes whose count changed."""
        if self.lists == 0:
            self._listed_ns = at_ns
            if at_ns > self.began_ns:
                self.began_ns = at_ns + REPLAY_NS
        self.last_ns, self.worker = at_ns, seen.worker
        self.lists += 1
        enough = self.lists > 1 and self.lists >= debounce.appear_lists
        self.settled = self.settled or (enough and at_ns - self._listed_ns >= debounce.appear_ns)
        moved: list[str] = []
        in_view = 0
        for each in islice(seen.classes, MOST_LISTED):
            tracked = self.classes.get(each.name) or self._add(each.name)
            if tracked is not None and tracked.listed != self.lists:
                tracked.listed = self.lists
                in_view += 1
                if tracked.advance(each, seen.worker, at_ns, debounce):
                    moved.append(each.name)
        if in_view < len(self.classes):
            moved += self._out_of_view(at_ns, debounce)
        return moved

    def count_of(self, name: str) -> int:
        """Return the number of objects of a class in view."""
        return self.classes[name].count.count if name in self.classes else 0

    def knows(self, name: str, vocabularies: Vocabularies) -> bool:
        """Whether it can report a class: its worker declares it, or it was reported here."""
        ever = name in self.classes and self.classes[name].first_ns > 0
        return ever or name in vocabularies.get((self.service, self.worker), ())

    def _out_of_view(self, at_ns: int, debounce: Debounce) -> list[str]:
        moved = []
        absent = [(name, tracked) for name, tracked in self.classes.items() if tracked.listed != self.lists]
        for name, tracked in absent:
            if tracked.count.count == 0 and tracked.first_ns == 0:
                del self.classes[name]  # flickered only
            elif tracked.count.advance(0, at_ns, debounce):
                tracked.move(came=False)
                moved.append(name)
        return moved

    def _add(self, name: str) -> Tracked | None:
        if len(self.classes) >= MAX_CLASSES:
            gone = [(tracked.last_ns, old) for old, tracked in self.classes.items() if tracked.count.count == 0]
            if not gone:
                return None
            del self.classes[min(gone)[1]]
        if self._room is not None and not self._room.take(name):
            return None
        tracked = self.classes[name] = Tracked()
        return tracked
