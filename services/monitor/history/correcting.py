"""SQL statements that correct times written by a clock that was ahead."""

from collections.abc import Iterator
from typing import Final

from sqlalchemy import ColumnElement, Update, case, update

from services.monitor.history.clock_trust import Correction
from services.monitor.history.tables import (
    acts,
    alerts,
    disagreements,
    forgotten,
    heartbeat,
    intervals,
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


def corrections(correction: Correction) -> Iterator[Update]:
    """Yield the statements that correct every table."""
    from_ns, ahead_ns = correction.from_ns, correction.ahead_ns

    def corrected(column: ColumnElement[int]) -> ColumnElement[int]:
        return case((column >= from_ns, column - ahead_ns), else_=column)

    for table, latest in LATEST.items():
        times = {column.name: corrected(column) for column in table.columns if column.name.endswith("_ns")}
        yield update(table).where(table.c[latest] >= from_ns).values(times)
