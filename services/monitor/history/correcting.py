"""Correcting times that were kept by a clock that was ahead, a bounded number of rows at a time."""

from typing import Final

from sqlalchemy import Table, Update, case, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from services.monitor.history.clock_trust import Correction
from services.monitor.history.tables import (
    acts,
    alerts,
    clock_correction,
    disagreements,
    forgotten,
    heartbeat,
    intervals,
    metadata,
    poses,
    presence,
)

LATEST: Final = {
    intervals: "until_ns",
    presence: "until_ns",
    disagreements: "until_ns",
    alerts: "changed_ns",
    acts: "at_ns",
    poses: "at_ns",
    forgotten: "at_ns",
    heartbeat: "at_ns",
}
"""The column of each table that is no earlier than its other times."""


SLICE: Final = 10_000
"""Rows that are corrected in one transaction."""


async def begin_correcting(connection: AsyncConnection, correction: Correction) -> None:
    """Write what is to be corrected, so that a monitor that ends meanwhile leaves it to the next one."""
    values = {"from_ns": correction.from_ns, "next_ns": correction.from_ns, "ahead_ns": correction.ahead_ns}
    await connection.execute(_corrected(heartbeat, correction).where(heartbeat.c.at_ns >= correction.from_ns))
    rows = [{"name": table.name, **values} for table in LATEST if table is not heartbeat]
    await connection.execute(clock_correction.insert(), rows)


async def correct_some(connection: AsyncConnection) -> bool:
    """Correct about SLICE rows of one table; return False if there was nothing to correct.

    Oldest first: what is corrected becomes older than that, and is met by no other slice.
    """
    of = clock_correction.c
    first = clock_correction.select().order_by(of.from_ns, of.name).limit(1)
    row = (await connection.execute(first)).one_or_none()
    if row is None:
        return False
    table = metadata.tables[row.name]
    latest = table.c[LATEST[table]]
    last_ns = await connection.scalar(
        select(latest).where(latest >= row.next_ns).order_by(latest).offset(SLICE - 1).limit(1)
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
