"""Events and numbers of a site's objects over time, as intervals of the history. Pure."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Final, Self

from msgspec.structs import replace

from schemas.world import ChangeKind, WorldChange
from services.monitor.history.interval_buffer import IntervalBuffer, StoredInterval
from services.monitor.world.site_objects import SITE, World
from services.monitor.world.site_status import Sites

NS: Final = 1_000_000_000

ONE_MOVE_NS: Final = 60 * NS
"""An object that moves again sooner than that moves on: the history has one row of all of it."""

MAX_MOVES: Final = 10_000
"""Objects whose last move is remembered to be continued."""

UNKNOWN_NS: Final = 30 * NS
"""How long nothing may be known of a site before its stock ends: a message that is lost is asked for within seconds."""

MAX_STOCK_CLASSES: Final = 64
"""Classes of a zone of which the history keeps how many there are, the first by name."""

ALL_CLASSES: Final = ""
"""Stands for all classes of a zone; a row of it says that what is there is known, even where that is nothing."""


class ObjectEvent(StoredInterval, frozen=True, gc=False):
    """An object appeared, moved, went, was back, or was merged into another one.

    since_ns, until_ns: of a move, as long as it went on; else the same. kind: a `schemas.world.ChangeKind`, not SEEN.
    name: its class. x, y: where it is then, metres in the site's map. from_x, from_y: where it was before a move.
    into: the id that it goes by from then on. by: the robot that saw it.
    """

    site: str
    object: str
    kind: str
    name: str
    x: float
    y: float
    from_x: float | None = None
    from_y: float | None = None
    into: str = ""
    by: str = ""

    @property
    def place(self) -> tuple[str, str, str]:
        """The site, the object and the kind of event."""
        return (self.site, self.object, self.kind)

    def is_as(self, _: Self) -> bool:
        """Return False: no event continues another one."""
        return False


class StockLevel(StoredInterval, frozen=True, gc=False):
    """A period in which a zone of a site held a constant number of objects of a class.

    zone: SITE for all of the site. name: the class, or ALL_CLASSES, of which there is a row whenever they are known.
    """

    site: str
    zone: str
    name: str
    count: int

    @property
    def place(self) -> tuple[str, str, str]:
        """The site, the zone and the class."""
        return (self.site, self.zone, self.name)

    def is_as(self, before: Self) -> bool:
        """Whether there were as many."""
        return self.count == before.count


class WorldHistory:
    """Enters what sites' objects do in a buffer: their events, and how many there are, where either changes."""

    def __init__(self, buffer: IntervalBuffer, world: World, sites: Sites) -> None:
        self._buffer = buffer
        self._world = world
        self._sites = sites
        self._moves: dict[tuple[str, str], ObjectEvent] = {}
        self._levels: dict[tuple[str, str], dict[str, int]] = {}
        self._versions: dict[str, int] = {}
        self._unknown_since_ns: dict[str, int] = {}

    def note(self, now_ns: int) -> Iterator[None]:
        """Enter what changed since the last call, and yield after each zone."""
        for name, site in list(self._world.sites.items()):
            self._enter(name, site.take_events(), now_ns)
            current = not site.is_behind and self._sites.is_current(name, now_ns)
            at_ns = now_ns
            if current:
                self._unknown_since_ns.pop(name, None)
            else:
                at_ns = self._unknown_since_ns.setdefault(name, now_ns)
                if abs(now_ns - at_ns) < UNKNOWN_NS:
                    continue
            version = site.version if current else -1
            if self._versions.get(name, -1) != version:
                self._versions[name] = version
                self._end_gone(name, {SITE, *(each.name for each in site.zones)}, at_ns)
                zones = site.zones
                for zone in (SITE, *(each.name for each in zones)):
                    if site.zones is not zones:
                        break  # others are in force since, which is another version
                    self._note((name, zone), _levels(site.count(zone)) if current else {}, at_ns)
                    yield

    def _end_gone(self, site: str, zones: Collection[str], at_ns: int) -> None:
        """End the levels of zones that are no more."""
        for place in [each for each in self._levels if each[0] == site and each[1] not in zones]:
            self._note(place, {}, at_ns)
            del self._levels[place]

    def _note(self, place: tuple[str, str], levels: dict[str, int], now_ns: int) -> None:
        before = self._levels.get(place, {})
        for name in before.keys() - levels.keys():
            self._buffer.end(StockLevel, (*place, name), now_ns)
        for name, count in levels.items():
            if before.get(name) != count:
                level = StockLevel(
                    since_ns=now_ns, until_ns=now_ns, open=True, site=place[0], zone=place[1], name=name, count=count
                )
                self._buffer.begin(level)
        self._levels[place] = levels

    def _enter(self, site: str, changes: Iterable[WorldChange], now_ns: int) -> None:
        for change in changes:
            event = event_of(site, change, now_ns)
            if change.kind is ChangeKind.MOVED:
                event = self._moving(event)
            else:
                self._moves.pop((site, event.object), None)
            self._buffer.note([event])

    def _moving(self, event: ObjectEvent) -> ObjectEvent:
        """Return a move together with the one that it continues, if any."""
        at = (event.site, event.object)
        last = self._moves.pop(at, None)
        if last is not None and event.since_ns - last.until_ns < ONE_MOVE_NS:
            since_ns = min(last.since_ns, event.since_ns)
            event = replace(event, since_ns=since_ns, from_x=last.from_x, from_y=last.from_y)
        self._moves[at] = event
        while len(self._moves) > MAX_MOVES:
            del self._moves[next(iter(self._moves))]
        return event


def event_of(site: str, change: WorldChange, now_ns: int) -> ObjectEvent:
    """Return a change as an event; one that is dated later than now happens now."""
    of, at_ns = change.object, min(change.at_ns, now_ns)
    return ObjectEvent(
        since_ns=at_ns,
        until_ns=at_ns,
        open=False,
        site=site,
        object=of.id,
        kind=change.kind,
        name=of.name,
        x=of.at[0],
        y=of.at[1],
        from_x=None if change.before is None else change.before[0],
        from_y=None if change.before is None else change.before[1],
        into=change.into or "",
        by=change.by,
    )


def _levels(counts: Mapping[str, int]) -> dict[str, int]:
    """Return how many objects there are of each class and in all, without classes of which there are none."""
    there = {name: count for name, count in sorted(counts.items()) if count > 0 and name}
    kept = dict(list(there.items())[:MAX_STOCK_CLASSES])
    return {ALL_CLASSES: sum(there.values()), **kept}
