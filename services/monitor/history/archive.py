"""Reads the history while it is written: pages of sightings and of alerts, newest first."""

import asyncio
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import (
    ColumnElement,
    LargeBinary,
    Select,
    Table,
    and_,
    cast,
    false,
    func,
    inspect,
    or_,
    select,
    text,
    true,
    tuple_,
)
from sqlalchemy.ext.asyncio import AsyncConnection

from schemas.alerts import Alert, AlertState
from services.monitor.history.counting import (
    Counts,
    cameras_available,
    count_over_time,
    in_stock,
    in_view,
    nothing_counted,
    stock_known,
)
from services.monitor.history.engine import CASEFOLD, engine_of, translating
from services.monitor.history.intervals import Interval
from services.monitor.history.opening import connect
from services.monitor.history.rows import act_of_row, alert_of_row, interval_of_row, select_alerts
from services.monitor.history.settings import NONE
from services.monitor.history.state import Act, HistoryError
from services.monitor.history.tables import (
    UNRESOLVED,
    acts,
    alert_objects,
    alerts,
    heartbeat,
    intervals,
    lasted,
    object_events,
    stock,
)
from services.monitor.history.world_history import ObjectEvent, StockLevel
from services.monitor.inventory.sighting import NS
from services.monitor.world.site_objects import SITE

ANY_LETTER: Final = "und-x-icu"
"""A collation of PostgreSQL's that knows the letters of all alphabets, whatever the database's own is."""

HAS_ANY_LETTER: Final = text("SELECT count(*) FROM pg_collation WHERE collname = :name")

BETWEEN: Final = "\x1f"
"""Between two names that are looked at together: that is several times as fast as one after the other."""


NOWHERE: Final = "\0"
"""A character that PostgreSQL has in no text, and takes in no parameter."""


async def contains(
    connection: AsyncConnection, columns: Sequence[ColumnElement[str]], wanted: str
) -> ColumnElement[bool]:
    """Return the condition for rows with a text in one of some columns.

    Only names that have other letters than ASCII's take the slow way. PostgreSQL without ICU knows the letters of the
    database's own locale alone.
    """
    if NOWHERE in wanted:
        return false()
    if BETWEEN in wanted and len(columns) > 1:
        return or_(*[await contains(connection, [each], wanted) for each in columns])
    folded, column = wanted.casefold(), columns[0]
    for each in columns[1:]:
        column = column.concat(BETWEEN).concat(each)
    if connection.dialect.name == "sqlite":
        has_others = or_(*(func.length(each) < func.length(cast(each, LargeBinary)) for each in columns))
        others = func.instr(getattr(func, CASEFOLD)(column), folded) > 0
    else:
        has_others = or_(*(func.char_length(each) < func.octet_length(each) for each in columns))
        known = await connection.scalar(HAS_ANY_LETTER, {"name": ANY_LETTER})
        upper = func.upper(column.collate(ANY_LETTER) if known else column)  # SS of the German sz, as casefold ss
        others = upper.contains(folded.upper(), autoescape=True)
    found = and_(has_others, others)
    if folded.isascii():
        plain = func.instr if connection.dialect.name == "sqlite" else func.strpos
        found = or_(plain(func.lower(column), folded) > 0, found)
    return found


MAX_ROWS: Final = 10_000
"""Of one page."""

AT_ONCE: Final = 4
"""How many pages are read at the same time."""

SAID: Final = ("robot", "camera", "name", "model", "worker")
"""The columns of a sighting that may have a text in them."""

FIRST_NS: Final = 60 * NS
"""How far back is looked first for the newest."""

HEARD_NS: Final = 60 * NS
"""How long ago the heartbeat may have been for what is open to go on now."""

SightingCursor = tuple[int, str, str, str]
"""since_ns, robot, camera and class of an interval: where a page ended."""

AlertCursor = tuple[int, str]
"""changed_ns and id of an alert: where a page ended."""


@dataclass(frozen=True, slots=True)
class HistoryQuery:
    """A query: between two times (epoch nanoseconds), of one robot, camera or class if named.

    text: what sightings have in one of their names, in capitals or not.
    """

    since_ns: int = 0
    until_ns: int = 2**63 - 1
    robot: str = ""
    camera: str = ""
    name: str = ""
    text: str = ""

    @property
    def is_nowhere(self) -> bool:
        """Whether it is about a robot, camera or class that no database can have."""
        return NOWHERE in self.robot + self.camera + self.name


EventCursor = tuple[int, str, str, str]
"""until_ns, site, object and kind of an event: where a page ended."""

StockCursor = tuple[int, str, str, str]
"""since_ns, site, zone and class of a stock level: where a page ended."""


@dataclass(frozen=True, slots=True)
class WorldQuery:
    """A query about sites between two times (epoch nanoseconds), of one site, object, class or zone if named.

    zone: None for every zone and whole sites, SITE for whole sites alone.
    """

    since_ns: int = 0
    until_ns: int = 2**63 - 1
    site: str = ""
    object: str = ""
    name: str = ""
    zone: str | None = None

    @property
    def is_nowhere(self) -> bool:
        """Whether it is about names that no database can have."""
        return NOWHERE in self.site + self.object + self.name + (self.zone or "")


class Archive:
    """Reads the database of the history. Every method raises HistoryError if it is absent or cannot be read."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._room = asyncio.Semaphore(AT_ONCE)

    async def sightings(self, asked: HistoryQuery, limit: int, after: SightingCursor | None = None) -> list[Interval]:
        """Return the newest intervals, those that began last first; after the place where another page ended."""
        if asked.is_nowhere:
            return []
        order = (intervals.c.since_ns, intervals.c.robot, intervals.c.camera, intervals.c.name)
        query = intervals.select().where(*_named(asked, intervals), intervals.c.since_ns <= asked.until_ns)
        query = _page(query, order, limit, after)
        async with self._connected() as connection:
            query = query.where(*await _with_text(connection, asked.text))
            at_ns = await _heartbeat_ns(connection)
            newest_ns = min(at_ns, asked.until_ns, at_ns if after is None else after[0])
            begins = [] if asked.robot else _ever_earlier(newest_ns, asked.since_ns)
            rows = await _last_begun(connection, intervals, query, (*begins, asked.since_ns), limit)
        return [interval_of_row(Interval, row, at_ns) for row in rows]

    async def counts(self, asked: HistoryQuery) -> Counts:
        """Return how many were in view over the time that is asked for, by class."""
        if asked.is_nowhere:
            return nothing_counted(asked.since_ns, asked.until_ns)
        async with self._connected() as connection:
            if connection.dialect.name == "postgresql":  # its compiler takes longer than the query
                await connection.exec_driver_sql("SET LOCAL jit = off")
            at_ns = await _heartbeat_ns(connection)
            until_ns = asked.until_ns if at_ns + HEARD_NS >= asked.until_ns else at_ns
            places = {"robot": asked.robot, "camera": asked.camera}
            cameras = {column: value for column, value in places.items() if value}
            classes = {"name": asked.name} if asked.name else {}
            seen = in_view({**cameras, **classes}, await _with_text(connection, asked.text), until_ns)
            available = cameras_available(cameras, until_ns)
            return await count_over_time(connection, seen, available, asked.since_ns, asked.until_ns)

    async def alerts(
        self, asked: HistoryQuery, limit: int, after: AlertCursor | None = None, *, states: Sequence[AlertState] = ()
    ) -> list[Alert]:
        """Return the alerts that changed last, in one of the states if any are named."""
        if asked.is_nowhere:
            return []
        async with self._connected() as connection:
            query = select_alerts() if await _has(connection, alert_objects) else alerts.select()
            query = query.where(
                *_named(asked, alerts), alerts.c.raised_ns <= asked.until_ns, alerts.c.changed_ns >= asked.since_ns
            )
            if states:
                query = query.where(alerts.c.state.in_(states))
            if states and AlertState.RESOLVED not in states:
                query = query.where(UNRESOLVED)  # which has an index
            query = _page(query, (alerts.c.changed_ns, alerts.c.id), limit, after)
            rows = (await connection.execute(query)).all()
        return [alert_of_row(row) for row in rows]

    async def object_events(self, asked: WorldQuery, limit: int, after: EventCursor | None = None) -> list[ObjectEvent]:
        """Return what became of objects, the newest first; after the place where another page ended."""
        if asked.is_nowhere:
            return []
        of = object_events.c
        given = {of.site: asked.site, of.object: asked.object, of.name: asked.name}
        where = [column == value for column, value in given.items() if value]
        query = object_events.select().where(*where, of.until_ns >= asked.since_ns, of.since_ns <= asked.until_ns)
        query = _page(query, (of.until_ns, of.site, of.object, of.kind), limit, after)
        return [interval_of_row(ObjectEvent, row) for row in await self._read_later(object_events, query)]

    async def stock(self, asked: WorldQuery, limit: int, after: StockCursor | None = None) -> list[StockLevel]:
        """Return the newest stock levels, those that began last first; after the place where another page ended."""
        if asked.is_nowhere:
            return []
        of = stock.c
        given = {of.site: asked.site, of.name: asked.name}
        where = [column == value for column, value in given.items() if value]
        where += [] if asked.zone is None else [of.zone == asked.zone]
        query = stock.select().where(*where, of.since_ns <= asked.until_ns)
        query = _page(query, (of.since_ns, of.site, of.zone, of.name), limit, after)
        async with self._connected() as connection:
            if not await _has(connection, stock):
                return []
            at_ns = await _heartbeat_ns(connection)
            begins = _ever_earlier(min(at_ns, asked.until_ns, at_ns if after is None else after[0]), asked.since_ns)
            rows = await _last_begun(connection, stock, query, (*begins, asked.since_ns), limit)
        return [interval_of_row(StockLevel, row, at_ns) for row in rows]

    async def stock_counts(self, asked: WorldQuery) -> Counts:
        """Return how many objects a zone held over the time that is asked for, by class."""
        zone = asked.zone or SITE
        async with self._connected() as connection:
            if asked.is_nowhere or not await _has(connection, stock):
                return nothing_counted(asked.since_ns, asked.until_ns)
            if connection.dialect.name == "postgresql":  # its compiler takes longer than the query
                await connection.exec_driver_sql("SET LOCAL jit = off")
            at_ns = await _heartbeat_ns(connection)
            until_ns = asked.until_ns if at_ns + HEARD_NS >= asked.until_ns else at_ns
            classes = {"name": asked.name} if asked.name else {}
            counted = in_stock({"site": asked.site, "zone": zone, **classes}, until_ns)
            known = stock_known(asked.site, zone, until_ns)
            return await count_over_time(connection, counted, known, asked.since_ns, asked.until_ns)

    async def acts(self, alert_ids: Sequence[str]) -> list[Act]:
        """Return the operators' actions on some alerts, in order."""
        query = acts.select().where(acts.c.alert_id.in_(alert_ids[:MAX_ROWS])).order_by(acts.c.at_ns).limit(MAX_ROWS)
        rows = await self._read(query)
        return [act_of_row(row) for row in rows]

    async def _read(self, query: Select[Any]) -> Sequence[Any]:
        async with self._connected() as connection:
            rows: Sequence[Any] = (await connection.execute(query)).all()
        return rows

    async def _read_later(self, table: Table, query: Select[Any]) -> Sequence[Any]:
        """Read a table that came later; empty where no monitor that knows it has written to the database yet."""
        async with self._connected() as connection:
            rows: Sequence[Any] = ()
            if await _has(connection, table):
                rows = (await connection.execute(query)).all()
        return rows

    @asynccontextmanager
    async def _connected(self) -> AsyncIterator[AsyncConnection]:
        if self._url == NONE:
            raise HistoryError("no history is kept: the monitor was started with --history none")
        async with self._room, translating():
            connection = await connect(engine_of(self._url), create=False)
            try:
                yield connection
            finally:
                await connection.close()


async def _has(connection: AsyncConnection, table: Table) -> bool:
    """Whether a database has a table that came later."""
    return await connection.run_sync(lambda of: inspect(of).has_table(table.name))


async def _heartbeat_ns(connection: AsyncConnection) -> int:
    """Return the time of the last write."""
    return await connection.scalar(select(heartbeat.c.at_ns)) or 0


def _page(query: Select[Any], order: Sequence[Any], limit: int, after: tuple[Any, ...] | None) -> Select[Any]:
    if after is not None:
        query = query.where(tuple_(*order) < tuple_(*after))
    return query.order_by(*(each.desc() for each in order)).limit(min(limit, MAX_ROWS))


async def _last_begun(
    connection: AsyncConnection, table: Table, query: Select[Any], begins: Sequence[int], most: int
) -> Sequence[Any]:
    """Return the rows of a query that began last. begins: ever earlier times to look from, the last of them for all."""
    rows: Sequence[Any] = ()
    for since_ns in begins:
        began = lasted(table, since_ns) & ((table.c.since_ns >= since_ns) if since_ns != begins[-1] else true())
        if len(rows := (await connection.execute(query.where(began))).all()) >= min(most, MAX_ROWS):
            break
    return rows


def _ever_earlier(newest_ns: int, since_ns: int) -> Iterator[int]:
    """Yield times from shortly before the newest one back to `since_ns`.

    Ends have an index and beginnings none: rows that began after a time are looked for among those that ended after it.
    """
    back_ns = FIRST_NS
    while newest_ns - back_ns > since_ns:
        yield newest_ns - back_ns
        back_ns *= 4


async def _with_text(connection: AsyncConnection, text: str) -> list[ColumnElement[bool]]:
    """Return the condition for intervals that have a text in one of their names."""
    if not text:
        return []
    return [await contains(connection, [intervals.c[each] for each in SAID], text)]


def _named(asked: HistoryQuery, table: Table) -> list[ColumnElement[bool]]:
    given = {"robot": asked.robot, "camera": asked.camera, "name": asked.name}
    return [table.c[column] == value for column, value in given.items() if value]
