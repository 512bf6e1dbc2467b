"""Counts in view over time, computed by the database: the maximum in each time slot.

Where little happened it is counted exactly, whether that is in all of the time or at the places that are asked for.
Where much did, as in a year of twenty robots, the database looks at every place at a number of moments, evenly spread:
a look is a step in an index, however long the history is.
"""

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    FromClause,
    Select,
    Table,
    and_,
    case,
    cast,
    func,
    join,
    literal,
    select,
    true,
    union_all,
)
from sqlalchemy.ext.asyncio import AsyncConnection

from services.monitor.history.rows import places_of
from services.monitor.history.tables import intervals, lasted, presence, stock
from services.monitor.history.world_history import ALL_CLASSES

SLOTS: Final = 360
FEWEST_SLOTS: Final = 12

EXACT: Final = 50_000
"""Up to how many intervals are counted exactly."""

LOOKS: Final = 20_000
"""How many steps in an index are taken otherwise, over all places and moments."""

MOST_LOOKS: Final = 4
"""Moments in one slot."""

Where = Sequence[ColumnElement[bool]]


@dataclass(frozen=True, slots=True)
class Slots:
    """Time slots of one width, in nanoseconds. until_ns: the end of the last slot, which may be shorter."""

    since_ns: int
    until_ns: int
    width_ns: int

    @property
    def number(self) -> int:
        """The number of slots."""
        return -(-(self.until_ns - self.since_ns) // self.width_ns)


@dataclass(frozen=True, slots=True)
class Counts:
    """The maximum of each class in each slot, by slot number; zeros are left out.

    known: the slots of which it is known what was in view, because a camera was available.
    """

    slots: Slots
    most: Mapping[str, Mapping[int, int]]
    known: AbstractSet[int]


@dataclass(frozen=True, slots=True)
class Counted:
    """Rows to count, each for `count` of a class `name`, and the time until which open rows last.

    places: columns of the primary key, and what is in them. where: what else is so of the rows.
    named: columns of the primary key that are not empty.
    """

    table: Table
    name: str
    count: ColumnElement[int]
    places: Mapping[str, str]
    where: Where
    open_until_ns: int
    named: Sequence[str] = ("robot", "camera")  # robots, and monitors, are present too

    def at(self, since_ns: int, until_ns: int) -> FromClause:
        """Return the rows of the places that may have lasted at a time between two, found by the primary key.

        At one place they follow each other, so of those that began before only the newest may last until then.
        """
        places, of = places_of(self.table), self.table.c
        same = [of[column.name] == places.c[column.name] for column in places.c]
        newest = select(func.max(of.since_ns)).where(*same, of.since_ns <= since_ns).scalar_subquery()
        some = select(*places.c, func.coalesce(newest, since_ns).label("from_ns")).where(*self.here(places)).cte()
        same = [of[column.name] == some.c[column.name] for column in places.c]
        return join(some, self.table, and_(*same, of.since_ns >= some.c.from_ns, of.since_ns < until_ns))

    def here(self, of: FromClause) -> list[ColumnElement[bool]]:
        """Return the condition that restricts a query to places, without their index: the index of times is better."""
        found = [of.c[column].concat("") == value for column, value in self.places.items()]
        return [*found, *(of.c[column] != "" for column in self.named)]


def in_view(places: Mapping[str, str], where: Where, open_until_ns: int) -> Counted:
    """Return the intervals in view, counted by class."""
    return Counted(intervals, "name", intervals.c.count, places, where, open_until_ns)


def cameras_available(places: Mapping[str, str], open_until_ns: int) -> Counted:
    """Return the times when cameras were available, counted without a class."""
    return Counted(presence, "", literal(1), places, (), open_until_ns)


def in_stock(places: Mapping[str, str], open_until_ns: int) -> Counted:
    """Return the stock levels of a zone, counted by class. places: the site, the zone, and a class if it is one."""
    return Counted(stock, "name", stock.c.count, places, (), open_until_ns, ("site", "name"))


def stock_known(site: str, zone: str, open_until_ns: int) -> Counted:
    """Return the times when the stock of a zone was known, counted without a class."""
    places = {"site": site, "zone": zone, "name": ALL_CLASSES}
    return Counted(stock, "", literal(1), places, (), open_until_ns, ("site",))


def nothing_counted(since_ns: int, until_ns: int) -> Counts:
    """Return the counts of a camera that there is not."""
    return Counts(_slots(since_ns, until_ns, SLOTS), {}, frozenset())


async def count_over_time(
    connection: AsyncConnection, seen: Counted, known: Counted, since_ns: int, until_ns: int
) -> Counts:
    """Count objects between two times, and find when it is known how many there were."""
    both, slots = (seen, known), _slots(since_ns, until_ns, SLOTS)
    exactly = [await _rows(connection, each, slots) for each in both]
    looked_at = [each for each, rows in zip(both, exactly, strict=True) if rows is None]
    places = sum([await _number_of_places(connection, each) for each in looked_at])
    slots = _slots(since_ns, until_ns, max(FEWEST_SLOTS, min(SLOTS, LOOKS // max(1, places))))
    looks = min(MOST_LOOKS, max(1, LOOKS // max(1, places * slots.number)))
    most, there = [
        _by_class((await connection.execute(_looked_at(each, slots, looks))).all())
        if rows is None
        else _carried((await connection.execute(_counted(each, rows, slots))).all(), slots)
        for each, rows in zip(both, exactly, strict=True)
    ]
    return Counts(slots, most, set().union(*there.values(), *most.values()))


def _slots(since_ns: int, until_ns: int, number: int) -> Slots:
    return Slots(since_ns, until_ns, max(1, -(-(until_ns - since_ns) // number)))


async def _rows(connection: AsyncConnection, wanted: Counted, slots: Slots) -> FromClause | None:
    """Return where the rows are that are counted exactly; None where these are more than EXACT."""
    table = wanted.table
    if await _are_few(connection, select(table.c.until_ns).where(table.c.until_ns >= slots.since_ns)):
        return table
    at = wanted.at(slots.since_ns, slots.until_ns)
    if wanted.places and await _are_few(connection, select(table.c.since_ns).select_from(at)):
        return at
    return None


async def _are_few(connection: AsyncConnection, rows: Select[Any]) -> bool:
    """Whether there are no more than EXACT; no more than that and one are looked at."""
    return (await connection.scalar(select(func.count()).select_from(rows.limit(EXACT + 1).subquery())) or 0) <= EXACT


async def _number_of_places(connection: AsyncConnection, wanted: Counted) -> int:
    at = places_of(wanted.table)
    return await connection.scalar(select(func.count()).select_from(at).where(*wanted.here(at))) or 0


def _counted(wanted: Counted, rows: FromClause, slots: Slots) -> Select[Any]:
    """Return what finds in some rows, by class and slot: its first change, the most at once, how many more are left."""
    table, count, of = wanted.table, wanted.count, wanted.table.c
    name = of[wanted.name] if wanted.name else literal("")
    ends = case((of.open, wanted.open_until_ns), else_=of.until_ns)
    here = (
        *wanted.here(table),
        *wanted.where,
        of.since_ns < slots.until_ns,
        lasted(table, slots.since_ns),
        ends > slots.since_ns,
    )
    here = (*here, ends > of.since_ns)
    begins = case((of.since_ns < slots.since_ns, slots.since_ns), else_=of.since_ns)
    more = select(name.label("name"), begins.label("at_ns"), count.label("more")).select_from(rows).where(*here)
    fewer = select(name, ends, -count).select_from(rows).where(*here, ends < slots.until_ns)
    moves = union_all(more, fewer).cte()
    at_once = select(moves.c.name, moves.c.at_ns, cast(func.sum(moves.c.more), BigInteger).label("more"))
    at_once_ = at_once.group_by(moves.c.name, moves.c.at_ns).cte()
    summed = func.sum(at_once_.c.more).over(partition_by=at_once_.c.name, order_by=at_once_.c.at_ns)
    slot = ((at_once_.c.at_ns - slots.since_ns) // slots.width_ns).label("slot")
    steps = select(at_once_.c.name, slot, at_once_.c.at_ns, summed.label("count"), at_once_.c.more).cte()
    changes = (func.min(steps.c.at_ns) - slots.since_ns, func.max(steps.c.count), func.sum(steps.c.more))
    by_slot = select(steps.c.name, steps.c.slot, *changes)
    return by_slot.group_by(steps.c.name, steps.c.slot).order_by(steps.c.name, steps.c.slot)


def _looked_at(wanted: Counted, slots: Slots, looks: int) -> Select[Any]:
    """Return what finds by class and slot the most at any of so many looks."""
    table = wanted.table
    step_ns = max(1, slots.width_ns // looks)
    until_ns = min(slots.until_ns, wanted.open_until_ns)
    look = select(literal(slots.since_ns, BigInteger).label("at_ns")).cte(recursive=True)
    look = look.union_all(select(look.c.at_ns + step_ns).where(look.c.at_ns + step_ns < until_ns))
    at, of = places_of(table), table.c
    same = and_(*(of[column.name] == at.c[column.name] for column in at.c))
    there = case((and_((of.until_ns > look.c.at_ns) | of.open, *wanted.where), wanted.count), else_=0)
    newest = select(there).where(same, of.since_ns <= look.c.at_ns).order_by(of.since_ns.desc()).limit(1)
    name = at.c[wanted.name] if wanted.name else literal("")
    each = select(name.label("name"), look.c.at_ns, newest.scalar_subquery().label("count"))
    each_ = each.select_from(at).join(look, true()).where(*wanted.here(at)).cte()
    summed = select(each_.c.name, each_.c.at_ns, func.sum(each_.c.count).label("count"))
    summed_ = summed.group_by(each_.c.name, each_.c.at_ns).cte()
    slot = ((summed_.c.at_ns - slots.since_ns) // slots.width_ns).label("slot")
    return select(summed_.c.name, slot, func.max(summed_.c.count)).group_by(summed_.c.name, slot)


def _by_class(rows: Sequence[Any]) -> dict[str, dict[int, int]]:
    most: dict[str, dict[int, int]] = {}
    for name, slot, count in rows:
        if count:
            most.setdefault(name, {})[int(slot)] = int(count)
    return most


def _carried(rows: Sequence[Any], slots: Slots) -> dict[str, dict[int, int]]:
    """Return the most of each class in each slot, also where nothing changed."""
    changes: dict[str, dict[int, tuple[int, int, int]]] = {}
    for name, slot, first_ns, most, more in rows:
        changes.setdefault(name, {})[int(slot)] = (int(first_ns), int(most), int(more))
    carried: dict[str, dict[int, int]] = {}
    for name, of in changes.items():
        before, carried[name] = 0, {}
        for slot in range(slots.number):
            first_ns, most, more = of.get(slot, (slots.until_ns, 0, 0))
            most = max(most, before if first_ns > slot * slots.width_ns else 0)
            if most:
                carried[name][slot] = most
            before += more
    return carried
