"""The objects in view of one camera, by its primary model. Pure."""

from collections.abc import Iterable, Iterator
from itertools import chain
from operator import attrgetter
from typing import Final

from schemas import worker_keys
from schemas.detections import ClassCount, ClassList
from schemas.distances import Distances, ObjectDistance
from schemas.header import FrameOrder
from schemas.keys import CameraKey
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.sighting import NS, Change, ChangeKind, Sighting
from services.monitor.inventory.view import MAX_CLASSES, ClassRoom, ModelView, Tracked, Vocabularies
from services.monitor.liveness import is_view_current

MAX_MODELS: Final = 4
"""How many models are followed on one camera, and how many second opinions."""

AFTERMATH_NS: Final = 60 * NS
"""Time for which a camera stays contested after its last second opinion expired, so that all parts notice."""


_NAME: Final = attrgetter("name")


class CameraView:
    """One camera's sightings. The first model heard is primary until it has been silent for a while.

    number: grows with each camera of an inventory. views: by model, those that may be primary. opinions: those that
    never are. vocabularies: read when models are compared.
    """

    __slots__ = (
        "_distance_order",
        "_opined_ns",
        "_room",
        "_vocabularies",
        "key",
        "lost",
        "number",
        "opinions",
        "primary",
        "views",
    )

    def __init__(
        self, key: CameraKey, vocabularies: Vocabularies | None = None, number: int = 0, room: ClassRoom | None = None
    ) -> None:
        self.key = key
        self.number = number
        self._room = room
        self._vocabularies = {} if vocabularies is None else vocabularies
        self.views: dict[str, ModelView] = {}
        self.opinions: dict[str, ModelView] = {}
        self.primary: ModelView | None = None
        self.lost = False
        self._opined_ns = 0
        self._distance_order = FrameOrder()

    @property
    def last_ns(self) -> int:
        """The arrival time of the primary model's newest class list; 0 before the first."""
        return self.primary.last_ns if self.primary else 0

    @property
    def settled(self) -> bool:
        """Whether enough lists came, without a gap, to tell that a class is absent."""
        return self.primary is not None and self.primary.settled

    def is_available(self, since_ns: int) -> bool:
        """Whether the view is current: lists came since then, and not only the one that late subscribers get."""
        view = self.primary
        return view is not None and is_view_current(view.lists, view.last_ns, since_ns, lost=self.lost)

    def see(self, seen: ClassList, at_ns: int, debounce: Debounce, silent_ns: int, lost_ns: int) -> list[Change] | None:
        """Take a class list; return None if it is a duplicate or late.

        silent_ns: silence of the primary model after which another one becomes primary.
        lost_ns: after how long without a list what was in view is given up.
        """
        view = self.views.get(seen.model)
        if view is None:
            view = self._add(seen.model, at_ns)
        if not view.order.take(seen.header, at_ns):
            return None
        lost = self.lose() if self.is_forsaken(at_ns - lost_ns) else []
        if self.lost:
            self.lost = False
            for each in self.views.values():
                each.begin_anew(at_ns)
        moved = view.advance(seen, at_ns, debounce)
        if view is not self.primary:
            if self.primary is not None and at_ns - self.primary.last_ns <= silent_ns:
                return lost
            return [*lost, *self._hand_over(self.primary, view)]
        return [*lost, *(self._change(name, view) for name in moved)]

    def opine(self, seen: ClassList, at_ns: int, debounce: Debounce, silent_ns: int) -> bool:
        """Take the class list of a second opinion; return False if it is a duplicate or late.

        silent_ns: after how long without a list what was in view is not known to be any more.
        """
        view = self.opinions.get(seen.model)
        if view is None:
            if len(self.opinions) >= MAX_MODELS:
                del self.opinions[min(self.opinions.values(), key=lambda view: view.last_ns).model]
            view = self.opinions[seen.model] = ModelView(seen.model, at_ns, worker_keys.OPINION, room=self._room)
        if not view.order.take(seen.header, at_ns):
            return False
        if at_ns - view.last_ns > silent_ns:
            view.begin_anew(at_ns)
        view.advance(seen, at_ns, debounce)
        self._opined_ns = at_ns
        return True

    def contested(self, since_ns: int) -> bool:
        """Whether several models may have looked: ever, or with second opinions since then or shortly before."""
        return len(self.views) > 1 or (bool(self.opinions) and self._opined_ns >= since_ns - AFTERMATH_NS)

    def measure(self, distances: Distances, at_ns: int) -> bool:
        """Take distances; return False if they are a duplicate or late."""
        if not self._distance_order.take(distances.header, at_ns):
            return False
        if self.primary is not None:
            nearest = nearest_of(distances.objects)
            for name, tracked in self.primary.classes.items():
                tracked.measure(nearest.get(name), at_ns)
        return True

    def is_forsaken(self, since_ns: int) -> bool:
        """Whether the view has expired: no class list has arrived since then."""
        return self.last_ns < since_ns and self.primary is not None and not self.lost

    def lose(self) -> list[Change]:
        """Drop the view: no class list has arrived for too long."""
        self.lost = True
        return [
            Change(ChangeKind.LOST, sighting, closest_m=sighting.closest_m)
            for sighting in self.sightings()
            if sighting.count
        ]

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now: the clock was set back."""
        for view in chain(self.views.values(), self.opinions.values()):
            view.set_back(now_ns)
        self._distance_order.set_back(now_ns)

    def restore(self, sighting: Sighting) -> None:
        """Take a stored sighting, whatever its model; the first model heard becomes primary."""
        view = self.primary or self._add(sighting.model, sighting.last_ns)
        fits = self._room is None or sighting.name in view.classes or self._room.take(sighting.name)
        if fits and (sighting.count or len(view.classes) < MAX_CLASSES):
            tracked = view.classes[sighting.name] = Tracked(sighting.count)
            tracked.score, tracked.worker, tracked.closest_m = sighting.score, sighting.worker, sighting.closest_m
            tracked.first_ns, tracked.last_ns = sighting.first_ns, sighting.last_ns
            tracked.count.since_ns = sighting.since_ns
            view.last_ns = max(view.last_ns, sighting.last_ns)

    def sightings(self, nearest_since_ns: int = 0) -> Iterator[Sighting]:
        """Yield each class that is or was in view; a distance older than `nearest_since_ns` is left out."""
        if self.primary is not None:
            for name, tracked in self.sighted():
                yield tracked.sighting(self.key, name, self.primary.model, nearest_since_ns)

    def sighted(self) -> Iterator[tuple[str, Tracked]]:
        """Yield each class that is or was in view; read only."""
        if self.primary is not None:
            yield from ((name, tracked) for name, tracked in self.primary.classes.items() if tracked.first_ns)

    def in_view(self) -> tuple[ClassCount, ...] | None:
        """Return the settled or last count of each class in view, by name; None before it is known."""
        if self.primary is None:
            return None
        counted = [
            ClassCount(name, tracked.count.count, tracked.score)
            for name, tracked in self.primary.classes.items()
            if tracked.count.count
        ]
        counted.sort(key=_NAME)
        return tuple(counted) if counted or self.primary.settled else None

    def others(self, since_ns: int) -> Iterator[ModelView]:
        """Yield the other models that sent enough lists since then."""
        for view in chain(self.views.values(), self.opinions.values()):
            if view is not self.primary and view.last_ns >= since_ns and view.settled:
                yield view

    def disagreements(self, since_ns: int) -> dict[str, tuple[int, int]]:
        """Return the classes on which two models settled on different counts since then: (primary, other).

        A class that one of them does not know is none: see `CameraView.knows`.
        """
        found: dict[str, tuple[int, int]] = {}
        if self.primary is None or not self.primary.settled:
            return found
        for view in self.others(since_ns):
            for name in {**self.primary.classes, **view.classes}:
                ours, theirs = self.primary.count_of(name), view.count_of(name)
                if ours != theirs and all(each.knows(name, self._vocabularies) for each in (self.primary, view)):
                    found[name] = (ours, theirs)
        return found

    def _add(self, model: str, at_ns: int) -> ModelView:
        if len(self.views) >= MAX_MODELS:
            silent = [view for view in self.views.values() if view is not self.primary]
            del self.views[min(silent, key=lambda view: view.last_ns).model]
        view = self.views[model] = ModelView(model, at_ns, room=self._room)
        if self.primary is None:
            self.primary = view
        return view

    def _hand_over(self, old: ModelView | None, new: ModelView) -> list[Change]:
        """Make another model primary, which continues the old one's sightings; return the changes."""
        self.primary = new
        before = {} if old is None else {name: tracked for name, tracked in old.classes.items() if tracked.first_ns}
        moved = [
            name
            for name, mine in new.classes.items()
            if mine.count.count and (name not in before or before[name].count.count != mine.count.count)
        ]
        if old is not None:
            new.take_over(moved, old.last_ns)
        for name in moved:
            tracked = new.classes[name]
            tracked.came = name not in before or before[name].count.count == 0
            if tracked.came:  # now, as the earlier primary model did not count it
                tracked.first_ns = tracked.count.since_ns
        for name, theirs in before.items():
            mine = new.classes.get(name)
            if mine is None or mine.count.count == 0:
                new.classes[name] = theirs
            elif theirs.count.count:
                mine.first_ns = theirs.first_ns
        if old is not None:
            self.views.pop(old.model, None)
        return [self._change(name, new) for name in moved]

    def _change(self, name: str, view: ModelView) -> Change:
        tracked = view.classes[name]
        sighting = tracked.sighting(self.key, name, view.model)
        if sighting.count == 0:
            return Change(ChangeKind.VANISHED, sighting, closest_m=tracked.before_m)
        kind = ChangeKind.APPEARED if tracked.came else ChangeKind.COUNTED
        first_look = tracked.came and tracked.first_ns <= view.began_ns
        return Change(kind, sighting, first_look=first_look, closest_m=tracked.before_m)


def nearest_of(objects: Iterable[ObjectDistance]) -> dict[str, float]:
    """Return the nearest object's distance of each class: straight if known, else along the optical axis."""
    nearest: dict[str, float] = {}
    for each in objects:
        if each.measured is not None:
            metres = each.measured.euclidean_m or each.measured.axial_m
            nearest[each.name] = min(metres, nearest.get(each.name, metres))
    return nearest
