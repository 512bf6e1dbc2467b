"""The objects of sites and their zones, kept up to date from a world model's changes. Pure."""

import math
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

import msgspec

from schemas.world import ChangeKind, SiteStatus, WorldChange, WorldChanges, WorldObject
from services.monitor.world.floor import ZoneFloor
from services.monitor.world.site_status import Sites
from services.monitor.world.zones import Zone, ZoneCount, ZoneFinder

MAX_SITE_OBJECTS: Final = 100_000
"""Objects of a site that are followed; a world model keeps as many unless told otherwise."""

MAX_TRANSITIONS: Final = 10_000
MAX_EVENTS: Final = 10_000
"""Changes that wait for the history; of more, the oldest are dropped."""

MAX_MERGED: Final = 10_000
"""Ids of merged objects that are followed to the one that they became; of more, the oldest are forgotten."""

MAX_MERGES: Final = 100
"""How often one object may have been merged, to be followed."""

CELL_M: Final = 2.0
"""Side of a cell of the index by place."""

NOTHING: Final[Mapping[str, tuple[float, float]]] = {}

MAX_BUFFERED: Final = 1_000
"""Messages that wait for the answer with all objects; of more, the oldest are dropped, and it is asked for again."""

LATEST: Final = 10
"""Statuses by which changes overtake them at most: both have queues of their own on the way."""

SITE: Final = ""
"""Stands for all of a site where a zone is named."""

MAX_FOLLOWED: Final = 100
"""Sites that are followed, those with zones before the others."""


class PlacedObject(msgspec.Struct, frozen=True, gc=False):
    """An object as it was told last, and the zones around the centre of its box."""

    of: WorldObject
    zones: tuple[str, ...]

    @property
    def name(self) -> str:
        """Its class."""
        return self.of.name

    @property
    def x(self) -> float:
        """Where the centre of its box is along the map's x axis, metres."""
        return self.of.at[0]

    @property
    def y(self) -> float:
        """Where the centre of its box is along the map's y axis, metres."""
        return self.of.at[1]


class Transition(msgspec.Struct, frozen=True, gc=False):
    """An object came, went, or changed its place. before, now: where it was and is; None where it was not there."""

    object_id: str
    name: str
    before: PlacedObject | None
    now: PlacedObject | None

    def was_in(self, zone: str) -> bool:
        """Whether it was in a zone."""
        return self.before is not None and zone in self.before.zones

    def is_in(self, zone: str) -> bool:
        """Whether it is in a zone."""
        return self.now is not None and zone in self.now.zones


class SiteObjects:
    """The objects of one site by id, and how many of each class are in each zone.

    Changes are applied in order. `is_behind` while some were missed, as before the first answer: then all objects have
    to be asked for. is_full: there are more objects than are followed; the others are in no total.
    floor: when that of zones was looked at, of those in `floor_wanted`, by name.
    transitions: what came, went and moved since somebody cleared them, the newest MAX_TRANSITIONS of it.
    version: grows with whatever changes of the objects.
    """

    def __init__(self, zones: Iterable[Zone], *, most: int = MAX_SITE_OBJECTS) -> None:
        self.zones: tuple[Zone, ...] = ()
        self.objects: dict[str, PlacedObject] = {}
        self.is_full = False
        self.is_behind = True
        self.version = 0
        self.transitions: deque[Transition] = deque(maxlen=MAX_TRANSITIONS)
        self._events: deque[WorldChange] = deque(maxlen=MAX_EVENTS)
        self._merged: dict[str, str] = {}
        self.floor_wanted: frozenset[str] = frozenset()
        self.floor: dict[str, ZoneFloor] = {}
        self._cells: dict[tuple[str, int, int], dict[str, tuple[float, float]]] = {}
        self._finder = ZoneFinder(())
        self._most = most
        self._counts: dict[str, Counter[str]] = {SITE: Counter()}
        self._epoch = ""
        self._last = 0
        self._told_last = 0
        self._had: deque[int] = deque(maxlen=LATEST)
        self._waiting: deque[WorldChanges] = deque(maxlen=MAX_BUFFERED)
        self.set_zones(zones)

    def set_zones(self, zones: Iterable[Zone]) -> None:
        """Have these zones from now on. An object that is in one now did not enter it, nor leave one that is gone."""
        before, self.zones = set(self.zones), tuple(zones)
        same = {zone.name for zone in self.zones if zone in before}
        self.floor = {name: each for name, each in self.floor.items() if name in same}
        self._finder = ZoneFinder(self.zones)
        self._counts = {SITE: self._counts[SITE], **{zone.name: Counter() for zone in self.zones}}
        for object_id, each in self.objects.items():
            there = self._finder.at(each.x, each.y, same.intersection(each.zones))
            placed = self.objects[object_id] = PlacedObject(each.of, there)
            for zone in placed.zones:
                self._counts[zone][placed.name] += 1
        self.version += 1

    def count(self, zone: str) -> Counter[str]:
        """Return how many objects of each class are in a zone, or in SITE; 0 for classes of which all have left."""
        return self._counts[zone]

    def known_as(self, object_id: str) -> PlacedObject | None:
        """Return the object with an id, or the one that it was merged into; None where neither is there."""
        for _ in range(MAX_MERGES):
            if object_id in self.objects or object_id not in self._merged:
                break
            object_id = self._merged[object_id]
        return self.objects.get(object_id)

    def take_events(self) -> list[WorldChange]:
        """Return what happened to objects since the last call; that some were merely seen again is left out."""
        events = list(self._events)
        self._events.clear()
        return events

    def take(self, changes: WorldChanges) -> None:
        """Apply the changes that are new; keep them for later while `is_behind`."""
        missed = changes.epoch != self._epoch or changes.first > self._last + 1
        if self.is_behind or missed:
            self.is_behind = True
            self._waiting.append(changes)
            return
        self._apply(changes)

    def hear(self, status: SiteStatus) -> None:
        """Compare with what the world model says.

        Be behind if changes that it told of a status ago never came, or if some came LATEST statuses ago that it knows
        nothing of: they were somebody else's, and its own with those numbers were taken for old ones.
        """
        unknown = len(self._had) == LATEST and status.last < self._had[0]
        if status.epoch != self._epoch or self._last < self._told_last or unknown:
            self.is_behind = True
        self._told_last = status.last
        self._had.append(self._last)

    def replace(self, epoch: str, last: int, objects: Iterable[WorldObject], *, complete: bool = True) -> None:
        """Take all objects as of the change numbered `last`, then the changes that came meanwhile.

        complete: False where there are more objects than these. Differences from the known objects of the same ids are
        transitions that happened while changes were missed.
        """
        before, cut, same_epoch = self.objects, self.is_full or not complete, epoch == self._epoch
        self._epoch, self._last, self._told_last, self.is_behind = epoch, last, last, False
        self._had.clear()  # a status may have been sent before the answer
        self.objects, self.is_full = {}, not complete
        self.version += 1
        self._cells.clear()
        self._counts = {zone: Counter(dict.fromkeys(counts, 0)) for zone, counts in self._counts.items()}
        for each in objects:
            self._put(each, before.get(each.id))
        waiting = [each for each in self._waiting if each.epoch == epoch]
        self._waiting.clear()
        for message in waiting:
            self._note_earlier(message, last)
        ids = before.keys() & self.objects.keys()
        if not ids and not same_epoch:
            self.transitions.clear()  # these objects are the first, or their ids began anew
        elif before and not cut and not self.is_full:
            ids = before.keys() | self.objects.keys()
        for object_id in ids:
            self._note(object_id, before.get(object_id), self.objects.get(object_id))
        for message in waiting:
            self.take(message)

    def _note_earlier(self, changes: WorldChanges, last: int) -> None:
        """Note what happened before the change numbered `last`, whose outcome is known by the answer with all objects.

        Moves are left out: those that the history has already would be there twice.
        """
        earlier = changes.changes[: max(0, last + 1 - changes.first)]
        for each in earlier:
            self._note_merge(each)
        self._events.extend(each for each in earlier if each.kind not in (ChangeKind.SEEN, ChangeKind.MOVED))

    def _apply(self, changes: WorldChanges) -> None:
        new = self._last + 1 - changes.first
        for change in changes.changes[new:]:
            self._change(change)
        self._last = max(self._last, changes.first + len(changes.changes) - 1)

    def _change(self, change: WorldChange) -> None:
        if change.kind is not ChangeKind.SEEN:
            self._events.append(change)
        self._note_merge(change)
        object_id = change.object.id
        before = self.objects.get(object_id)
        if change.kind in (ChangeKind.GONE, ChangeKind.MERGED):
            self.version += 1
            self.objects.pop(object_id, None)
            self._move(object_id, before, None)
        else:
            self._put(change.object, before)
        self._note(object_id, before, self.objects.get(object_id))

    def _note_merge(self, change: WorldChange) -> None:
        if change.into is None:
            self._merged.pop(change.object.id, None)
            return
        self._merged[change.object.id] = change.into
        if len(self._merged) > MAX_MERGED:
            del self._merged[next(iter(self._merged))]

    def _put(self, of: WorldObject, before: PlacedObject | None) -> None:
        """Have an object. before: as it was known last, be it before all were replaced."""
        known = self.objects.get(of.id)
        if known is None and len(self.objects) >= self._most:
            self.is_full = True
            return
        self.version += 1
        zones = () if before is None else before.zones
        if before is None or not _is_there(before, of):
            zones = self._finder.at(*of.at[:2], zones)
        placed = self.objects[of.id] = PlacedObject(of, zones)
        if known is None or not _is_there(known, of):
            self._move(of.id, known, placed)

    def near(self, name: str, x: float, y: float, than_m: float) -> list[tuple[float, str]]:
        """Return how far each object of a class that is nearer than that is, in metres, and its id; nearest first."""
        low, high = _cell(name, x - than_m, y - than_m), _cell(name, x + than_m, y + than_m)
        found = [
            ((at[0] - x) ** 2 + (at[1] - y) ** 2, each)
            for across in range(low[1], high[1] + 1)
            for up in range(low[2], high[2] + 1)
            for each, at in self._cells.get((name, across, up), NOTHING).items()
        ]
        return [(math.sqrt(square), each) for square, each in sorted(found) if square < than_m**2]

    def _note(self, object_id: str, before: PlacedObject | None, now: PlacedObject | None) -> None:
        """Note a transition if there is one. A merged object left only the zones that the one it became is not in."""
        into = self.known_as(object_id)
        if now is None and before is not None and into is not None:
            if not (left := tuple(zone for zone in before.zones if zone not in into.zones)):
                return
            before = PlacedObject(before.of, left)
        of = now or before
        if of is not None and (before is None or now is None or not _is_there(before, now.of)):
            self.transitions.append(Transition(object_id, of.name, before, now))

    def _move(self, object_id: str, before: PlacedObject | None, now: PlacedObject | None) -> None:
        if before is not None:
            cell = _cell(before.name, before.x, before.y)
            self._cells[cell].pop(object_id, None)
            if not self._cells[cell]:
                del self._cells[cell]
        if now is not None:
            self._cells.setdefault(_cell(now.name, now.x, now.y), {})[object_id] = now.x, now.y
        for zone in () if before is None else (SITE, *before.zones):
            self._counts[zone][before.name] -= 1  # type: ignore[union-attr]
        for zone in () if now is None else (SITE, *now.zones):
            self._counts[zone][now.name] += 1  # type: ignore[union-attr]


def _is_there(placed: PlacedObject, of: WorldObject) -> bool:
    """Whether an object is of the class and at the place that it was."""
    return (placed.name, placed.x, placed.y) == (of.name, *of.at[:2])


def _cell(name: str, x: float, y: float) -> tuple[str, int, int]:
    return name, math.floor(x / CELL_M), math.floor(y / CELL_M)


class World:
    """The sites that world models tell of, and those with zones, by name.

    on: False for a monitor that follows no world model: it has no sites.
    """

    def __init__(self, zones: Sequence[Zone] = (), *, on: bool = True) -> None:
        self.on = on
        self.sites: dict[str, SiteObjects] = {}
        self._left_out = ""
        self.set_zones(zones)

    def set_zones(self, zones: Iterable[Zone]) -> None:
        """Have these zones from now on."""
        by_site: defaultdict[str, list[Zone]] = defaultdict(list)
        for zone in zones:
            by_site[zone.site].append(zone)
        for name in sorted(by_site.keys() | self.sites.keys()):
            site = self.sites.setdefault(name, SiteObjects(()))
            if site.zones != tuple(by_site[name]):
                site.set_zones(by_site[name])

    def zones(self, sites: Sites, now_ns: int) -> Iterator[ZoneCount]:
        """Yield each zone with its objects, by site, in the order of the file. sites: whose models are there."""
        for name, site in self.sites.items():
            current = not site.is_behind and sites.is_current(name, now_ns)
            for zone in site.zones:
                yield ZoneCount(zone, site.count(zone.name), current)

    def problems(self) -> Iterator[str]:
        """Yield a line for each site of which not all objects are followed, and one where there are too many sites."""
        for name, site in self.sites.items():
            if site.is_full:
                yield (
                    f"site {name} has more than {len(site.objects):,} objects; the others are counted nowhere: divide"
                    " it into several sites (fleetsight worldmodel --sites)"
                )
        if self._left_out:
            yield (
                f"site {self._left_out} is not followed, as {MAX_FOLLOWED} others are: run another monitor for it,"
                " or restart this one if some of these are gone"
            )

    def hear(self, status: SiteStatus) -> None:
        """Take what a world model says of its site, which is followed from now on."""
        site = self.sites.get(status.site)
        if site is None:
            if not self.on or len(self.sites) >= MAX_FOLLOWED:
                self._left_out = status.site if self.on else ""
                return
            site = self.sites[status.site] = SiteObjects(())
        site.hear(status)
