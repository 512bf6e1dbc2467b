"""What became of a site's objects, and how many there were, as the history keeps it, on either database."""

import asyncio
import time
from collections.abc import Iterator

import pytest

from schemas.world import ChangeKind, WorldChange
from services.monitor.history.archive import Archive, WorldQuery
from services.monitor.history.interval_buffer import IntervalBuffer
from services.monitor.history.settings import HistorySettings
from services.monitor.history.world_history import (
    ALL_CLASSES,
    MAX_STOCK_CLASSES,
    ONE_MOVE_NS,
    UNKNOWN_NS,
    ObjectEvent,
    StockLevel,
    WorldHistory,
)
from services.monitor.history.writer import HistoryWriter
from services.monitor.inventory.inventory import Inventory
from services.monitor.world.site_objects import SITE, World
from services.monitor.world.site_status import FRESH_NS, Sites
from tests.services.monitor.history.test_store import opened
from tests.services.monitor.world.test_site_objects import DOCK, changes, thing
from tests.services.monitor.world.test_site_status import status
from tests.waiting import until

S = 1_000_000_000
NOW = 1_700_000_000 * S
APPEARED, MOVED, GONE, BACK, MERGED, SEEN = (ChangeKind(kind) for kind in ChangeKind)


class Hall:
    """A site that a world model tells of, and what the history has of it."""

    def __init__(self) -> None:
        self.world, self.sites, self.buffer = World([DOCK]), Sites(), IntervalBuffer()
        self.history = WorldHistory(self.buffer, self.world, self.sites)
        self.number = 0
        self.world.sites["hall"].replace("e", 0, [])

    def tell(
        self,
        kind: ChangeKind,
        object_id: str,
        x: float,
        at_s: float = 0,
        *,
        from_x: float | None = None,
        into: str = "",
    ) -> None:
        change = WorldChange(
            kind=kind,
            at_ns=NOW + round(at_s * S),
            object=thing(object_id, x),
            by="r1",
            before=None if from_x is None else (from_x, 1.0, 0.5),
            into=into or None,
        )
        self.number += 1
        self.world.sites["hall"].take(changes(self.number, change))

    def note(self, at_s: float = 0, *, there: bool = True) -> None:
        if there:
            self.sites.take(status("hall"), NOW + round(at_s * S))
        for _ in self.history.note(NOW + round(at_s * S)):
            pass

    def written(self) -> Iterator[object]:
        some = self.buffer.pending(10_000)
        self.buffer.written(some)
        return iter(some)

    def events(self) -> list[ObjectEvent]:
        return [each for each in self.written() if isinstance(each, ObjectEvent)]

    def levels(self) -> dict[tuple[str, str], list[tuple[int, float, float, bool]]]:
        """Return the count, the beginning and end in seconds, and whether it is open, of each zone and class."""
        found: dict[tuple[str, str], list[tuple[int, float, float, bool]]] = {}
        for each in self.written():
            if isinstance(each, StockLevel):
                spans = (each.since_ns - NOW) / S, (each.until_ns - NOW) / S
                found.setdefault((each.zone, each.name), []).append((each.count, *spans, each.open))
        return found


@pytest.fixture
def hall() -> Hall:
    return Hall()


def test_what_happens_is_entered_but_not_that_something_is_still_seen(hall: Hall) -> None:
    hall.tell(APPEARED, "a", 1, 1)
    hall.tell(SEEN, "a", 1, 2)
    hall.tell(MERGED, "a", 1, 3, into="b")
    hall.tell(GONE, "a", 1, 99)
    hall.note(5)
    events = hall.events()
    assert [(each.kind, each.object, (each.since_ns - NOW) / S, each.into, each.by) for each in events] == [
        (APPEARED, "a", 1, "", "r1"),
        (MERGED, "a", 3, "b", "r1"),
        (GONE, "a", 5, "", "r1"),  # not later than now
    ]
    hall.note(6)
    assert hall.events() == []


def test_an_object_that_moves_on_has_one_row_from_where_it_began_to_where_it_is(hall: Hall) -> None:
    for number in range(5):
        hall.tell(MOVED, "f", number + 1, 10 * number, from_x=float(number))
        hall.note(10 * number)
    (move,) = hall.events()
    assert (move.from_x, move.x, (move.since_ns - NOW) / S, (move.until_ns - NOW) / S) == (0, 5, 0, 40)
    later_s = 40 + ONE_MOVE_NS / S
    hall.tell(MOVED, "f", 6, later_s, from_x=5.0)
    hall.note(later_s)
    (move,) = hall.events()
    assert (move.from_x, move.x, (move.since_ns - NOW) / S) == (5, 6, later_s)
    hall.tell(GONE, "f", 6, later_s + 1)
    hall.tell(BACK, "f", 6, later_s + 2)
    hall.tell(MOVED, "f", 7, later_s + 3, from_x=6.0)
    hall.note(later_s + 3)
    assert [(each.kind, each.from_x) for each in hall.events()] == [(GONE, None), (BACK, None), (MOVED, 6)]


def test_the_stock_of_a_zone_that_is_removed_ends_and_that_of_a_new_one_begins(hall: Hall) -> None:
    hall.tell(APPEARED, "a", 1)
    hall.note(0)
    hall.levels()
    hall.world.set_zones([DOCK.model_copy(update={"name": "quay"})])
    hall.note(5)
    assert hall.levels() == {
        ("dock", ALL_CLASSES): [(1, 0, 5, False)],
        ("dock", "box"): [(1, 0, 5, False)],
        ("quay", ALL_CLASSES): [(1, 5, 5, True)],
        ("quay", "box"): [(1, 5, 5, True)],
    }


def test_stock_is_entered_on_change_alone(hall: Hall) -> None:
    hall.note(0)
    assert hall.levels() == {(SITE, ALL_CLASSES): [(0, 0, 0, True)], ("dock", ALL_CLASSES): [(0, 0, 0, True)]}
    hall.tell(APPEARED, "a", 1)
    hall.note(1)
    hall.levels()
    hall.tell(SEEN, "a", 1.1)
    hall.note(2)
    assert hall.levels() == {}
    hall.tell(MOVED, "a", 9, from_x=1.0)
    hall.note(3)
    assert hall.levels() == {
        ("dock", "box"): [(1, 1, 3, False)],
        ("dock", ALL_CLASSES): [(1, 1, 3, False), (0, 3, 3, True)],
    }


def test_while_the_world_model_is_silent_nothing_is_known_and_a_gap_is_left(hall: Hall) -> None:
    hall.tell(APPEARED, "a", 9)
    hall.note(0)
    hall.levels()
    silent_s = FRESH_NS / S + 1
    hall.note(silent_s, there=False)
    assert hall.levels() == {}, "it may be known again at once"
    hall.note(silent_s + UNKNOWN_NS / S, there=False)
    assert hall.levels() == {
        (SITE, ALL_CLASSES): [(1, 0, silent_s, False)],
        (SITE, "box"): [(1, 0, silent_s, False)],
        ("dock", ALL_CLASSES): [(0, 0, silent_s, False)],
    }
    hall.note(60)
    assert hall.levels()[SITE, "box"] == [(1, 60, 60, True)]


def test_a_moment_in_which_nothing_is_known_ends_no_level(hall: Hall) -> None:
    hall.tell(APPEARED, "a", 9)
    hall.note(0)
    hall.levels()
    silent_s = FRESH_NS / S + 1
    hall.note(silent_s, there=False)
    hall.note(silent_s + 1)
    hall.note(silent_s + UNKNOWN_NS / S + 2)
    assert hall.levels() == {}


def test_classes_of_a_zone_are_limited_and_the_sum_is_of_all(hall: Hall) -> None:
    names = [f"c{number:03}" for number in range(MAX_STOCK_CLASSES + 3)]
    hall.world.sites["hall"].replace("e", 0, [thing(name, 9, name=name) for name in names])
    hall.note(0)
    levels = hall.levels()
    assert {name for zone, name in levels if zone == SITE} == {ALL_CLASSES, *names[:MAX_STOCK_CLASSES]}
    assert levels[SITE, ALL_CLASSES] == [(len(names), 0, 0, True)]


async def test_a_monitor_keeps_it_and_it_is_read_pruned_and_goes_on_after_a_restart(url: str) -> None:
    world, sites = World([DOCK]), Sites()
    history = HistoryWriter(HistorySettings(history=url), Inventory(), world=(world, sites))
    await history.restore()
    running = asyncio.create_task(history.run())
    site = world.sites["hall"]
    site.replace("e", 0, [])
    began_ns = time.time_ns()
    for number, kind in enumerate((APPEARED, MOVED, GONE, BACK), 1):
        at_ns = began_ns + number
        of = WorldChange(kind=kind, at_ns=at_ns, object=thing("a", 1, name="b\0x"), by="r1")
        site.take(changes(number, of))
    sites.take(status("hall"), time.time_ns())

    async def stored() -> list[StockLevel]:
        async with opened(url) as store:
            return await store.select(StockLevel)

    while not (levels := await stored()):  # noqa: ASYNC110 - nobody tells
        await asyncio.sleep(0.1)
    await until(lambda: history.status.pending == 0)
    archive = Archive(url)
    events = await archive.object_events(WorldQuery(site="hall", object="a"), 3)
    assert [each.kind for each in events] == [BACK, GONE, MOVED]
    last = events[-1]
    rest = await archive.object_events(
        WorldQuery(site="hall"), 3, after=(last.until_ns, last.site, last.object, last.kind)
    )
    assert [each.kind for each in rest] == [APPEARED]
    assert await archive.object_events(WorldQuery(site="hall", object="b"), 9) == []
    assert await archive.object_events(WorldQuery(object="\0"), 9) == []
    assert {(each.zone, each.name, each.count) for each in levels if each.open} == {
        (zone, name, 1) for zone in (SITE, "dock") for name in (ALL_CLASSES, "b\N{SYMBOL FOR NULL}x")
    }
    running.cancel()
    await asyncio.wait([running])
    async with opened(url) as store:
        await store.prune(time.time_ns() + S)
        assert await store.select(ObjectEvent) == []
        assert len(await store.select(StockLevel)) == 4  # they are open
    again = HistoryWriter(HistorySettings(history=url), Inventory(), world=(World([DOCK]), Sites()))
    await again.restore()
    running = asyncio.create_task(again.run())
    await until(lambda: again.status.leads and again.status.pending == 0)
    running.cancel()
    await asyncio.wait([running])
    assert not any(each.open for each in await stored())
