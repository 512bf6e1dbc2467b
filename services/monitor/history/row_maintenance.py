"""SQL that deletes old rows, and corrects times written by a clock that was ahead. Both in bounded steps."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Final

from sqlalchemy import ColumnElement, Table, Update, case, delete, exists, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from schemas.alerts import AlertState
from services.monitor.history.clock_trust import Correction
from services.monitor.history.engine import engine_of, file_of, name_of, translating
from services.monitor.history.opening import connect
from services.monitor.history.rows import TABLES
from services.monitor.history.state import HistoryError
from services.monitor.history.tables import (
    acts,
    alert_objects,
    alerts,
    clock_correction,
    disagreements,
    forgotten,
    heartbeat,
    intervals,
    metadata,
    object_events,
    poses,
    presence,
    stock,
    webhook_backlog,
)

SLICE: Final = 10_000
"""Rows of a table that are forgotten, or looked at, at once: a database takes its time over many, and others wait."""

FREE_SHARE: Final = 20
"""One part in so many of an SQLite file may be free pages, which new rows fill; of more the file is made smaller."""

FREED_PAGES: Final = 2_000
"""How many pages, of 4,096 bytes, an SQLite file shrinks by at once."""

Step = Callable[[AsyncConnection], Awaitable[bool]]


class Pruning:
    """Deletes rows that ended before a time, and returns an SQLite file's free pages."""

    def __init__(self) -> None:
        self._acts_from = ""

    def steps(self, before_ns: int) -> list[Step]:
        """Return the steps, each its own transaction; a step returns whether it is complete."""
        return [
            *(_of_intervals(table, before_ns) for table in TABLES.values()),
            *(_of_robots(table, before_ns) for table in (poses, forgotten)),
            lambda connection: _prune_alerts(connection, before_ns),
            lambda connection: self._prune_acts(connection, before_ns),
        ]

    async def _prune_acts(self, connection: AsyncConnection, before_ns: int) -> bool:
        """Forget the old acts of alerts that are gone, of the next SLICE acts by their alerts' ids."""
        ids = select(acts.c.alert_id).where(acts.c.alert_id > self._acts_from).order_by(acts.c.alert_id)
        last = await connection.scalar(ids.offset(SLICE - 1).limit(1))
        here = acts.c.alert_id > self._acts_from
        if last is not None:
            here &= acts.c.alert_id <= last
        is_gone = ~exists().where(alerts.c.id == acts.c.alert_id)
        await connection.execute(delete(acts).where(here, acts.c.at_ns < before_ns, is_gone))
        self._acts_from = last or ""
        return last is None


def _of_intervals(table: Table, before_ns: int) -> Step:
    async def prune(connection: AsyncConnection) -> bool:
        ended = table.c.open.is_(False) & (table.c.until_ns < before_ns)
        last_ns, is_all = await _slice(connection, table.c.until_ns, ended, before_ns)
        await connection.execute(delete(table).where(ended, table.c.until_ns <= last_ns))
        return is_all

    return prune


def _of_robots(table: Table, before_ns: int) -> Step:
    async def prune(connection: AsyncConnection) -> bool:
        old = select(table.c.robot).where(table.c.at_ns < before_ns).limit(SLICE)
        deleted = await connection.execute(delete(table).where(table.c.robot.in_(old)))
        return deleted.rowcount < SLICE

    return prune


async def _prune_alerts(connection: AsyncConnection, before_ns: int) -> bool:
    """Forget resolved alerts, what people did with them, and that webhooks did not take alerts that are gone."""
    old = (alerts.c.changed_ns < before_ns) & (alerts.c.state == AlertState.RESOLVED)
    last_ns, is_all = await _slice(connection, alerts.c.changed_ns, old, before_ns)
    old &= alerts.c.changed_ns <= last_ns
    await connection.execute(delete(acts).where(acts.c.alert_id.in_(select(alerts.c.id).where(old))))
    await connection.execute(delete(alert_objects).where(alert_objects.c.alert_id.in_(select(alerts.c.id).where(old))))
    await connection.execute(delete(alerts).where(old))
    is_gone = ~exists().where(alerts.c.id == webhook_backlog.c.alert_id)
    await connection.execute(delete(webhook_backlog).where(is_gone))
    return is_all


async def _slice(
    connection: AsyncConnection, at_ns: ColumnElement[int], old: ColumnElement[bool], before_ns: int
) -> tuple[int, bool]:
    """Return the time of the SLICE-th row in order, and whether there are fewer; all rows of that moment are in it."""
    found = await connection.scalar(select(at_ns).where(old).order_by(at_ns).offset(SLICE - 1).limit(1))
    return (before_ns, True) if found is None else (found, False)


async def shrink(connection: AsyncConnection) -> bool:
    """Release some free pages of an SQLite file that has many; return whether none are left to release.

    A file that an earlier release made keeps its size: its free pages are used again, see `compact`.
    """
    pragma = connection.exec_driver_sql
    if not (await pragma("PRAGMA auto_vacuum")).scalar():
        return True
    free, pages = [int((await pragma(f"PRAGMA {of}_count")).scalar() or 0) for of in ("freelist", "page")]
    if free * FREE_SHARE <= pages:
        return True
    driver: Any = (await connection.get_raw_connection()).driver_connection
    await driver.executescript(f"PRAGMA incremental_vacuum({FREED_PAGES})")  # `execute` would free a single page
    return free <= FREED_PAGES


LONG_S: Final = 3_600.0


async def compact(url: str) -> str:
    """Rewrite an SQLite file so that it shrinks by itself from then on; return a message about it.

    A file that an earlier release made does so only after this. It takes up to as much free disk as the file has twice:
    for SQLite's temporary copy in SQLITE_TMPDIR, else TMPDIR, else /var/tmp, and for `-wal` beside the file. A monitor
    that runs keeps no history meanwhile: changes wait.

    Raises:
        HistoryError: it is no SQLite file, or cannot be written.
    """
    engine = engine_of(url)
    file = file_of(engine)
    if file is None:
        raise HistoryError(f"{name_of(engine)}: only a file of SQLite's is compacted; PostgreSQL looks after its own")
    connection = await connect(engine, create=False)
    try:
        before = await asyncio.to_thread(lambda: file.stat().st_size)
        async with translating(LONG_S):
            for statement in ("PRAGMA auto_vacuum=INCREMENTAL", "VACUUM", "PRAGMA wal_checkpoint(TRUNCATE)"):
                await connection.exec_driver_sql(statement)
    finally:
        await connection.close()
        await engine.dispose()
    after = await asyncio.to_thread(lambda: file.stat().st_size)
    return f"{file}: {before / 1e6:.1f} MB, {after / 1e6:.1f} MB after"


LATEST: Final = {
    intervals: "until_ns",
    presence: "until_ns",
    disagreements: "until_ns",
    stock: "until_ns",
    object_events: "until_ns",
    alerts: "changed_ns",
    acts: "at_ns",
    poses: "at_ns",
    forgotten: "at_ns",
    heartbeat: "at_ns",
}
"""The column of each table that is no earlier than its other times."""


CORRECTED_ROWS: Final = 10_000
"""Rows that are corrected in one transaction."""


async def begin_correcting(connection: AsyncConnection, correction: Correction) -> None:
    """Write what is to be corrected, so that a monitor that ends meanwhile leaves it to the next one."""
    values = {"from_ns": correction.from_ns, "next_ns": correction.from_ns, "ahead_ns": correction.ahead_ns}
    await connection.execute(_corrected(heartbeat, correction).where(heartbeat.c.at_ns >= correction.from_ns))
    rows = [{"name": table.name, **values} for table in LATEST if table is not heartbeat]
    await connection.execute(clock_correction.insert(), rows)


async def correct_some(connection: AsyncConnection) -> bool:
    """Correct about CORRECTED_ROWS rows of one table; return False if there was nothing to correct.

    Oldest first: corrected rows become older than that, and are met by no other slice.
    """
    of = clock_correction.c
    first = clock_correction.select().order_by(of.from_ns, of.name).limit(1)
    row = (await connection.execute(first)).one_or_none()
    if row is None:
        return False
    table = metadata.tables[row.name]
    latest = table.c[LATEST[table]]
    last_ns = await connection.scalar(
        select(latest).where(latest >= row.next_ns).order_by(latest).offset(CORRECTED_ROWS - 1).limit(1)
    )
    these = (latest >= row.next_ns) if last_ns is None else latest.between(row.next_ns, last_ns)
    await connection.execute(_corrected(table, Correction(row.from_ns, row.ahead_ns)).where(these))
    same = (of.name == row.name) & (of.from_ns == row.from_ns)
    if last_ns is None:
        await connection.execute(clock_correction.delete().where(same))
    else:
        await connection.execute(clock_correction.update().where(same).values(next_ns=last_ns + 1))
    return True


def _corrected(table: Table, correction: Correction) -> Update:
    from_ns, ahead_ns = correction.from_ns, correction.ahead_ns
    times = [column for column in table.columns if column.name.endswith("_ns")]
    return update(table).values({of.name: case((of >= from_ns, of - ahead_ns), else_=of) for of in times})
