"""The history as it is read while it is written: pages of what was seen and of alerts, newest first."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import ColumnElement, Select, Table, select, tuple_

from schemas.alerts import Alert, AlertState
from services.monitor.history.acts import Act
from services.monitor.history.engine import engine_of, translating
from services.monitor.history.errors import HistoryError
from services.monitor.history.intervals import Interval
from services.monitor.history.opening import connect
from services.monitor.history.rows import act_of_row, alert_of_row, interval_of_row
from services.monitor.history.settings import NONE
from services.monitor.history.tables import acts, alerts, heartbeat, intervals, lasted

MAX_ROWS: Final = 10_000
"""Of one page."""

AT_ONCE: Final = 4
"""How many pages are read at the same time."""

SightingPlace = tuple[int, str, str, str]
"""since_ns, robot, camera and class of an interval: where a page ended."""

AlertPlace = tuple[int, str]
"""changed_ns and id of an alert: where a page ended."""


@dataclass(frozen=True, slots=True)
class Asked:
    """What is asked for: what was so between two times (epoch nanoseconds), of one robot, camera or class if named."""

    since_ns: int = 0
    until_ns: int = 2**63 - 1
    robot: str = ""
    camera: str = ""
    name: str = ""


class Archive:
    """Reads the database of the history. Every method raises HistoryError: there is none, or it cannot be read."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._room = asyncio.Semaphore(AT_ONCE)

    async def sightings(self, asked: Asked, limit: int, after: SightingPlace | None = None) -> list[Interval]:
        """Return the newest intervals, those that began last first; after the place where another page ended."""
        order = (intervals.c.since_ns, intervals.c.robot, intervals.c.camera, intervals.c.name)
        query = intervals.select().where(
            *_named(asked, intervals), intervals.c.since_ns <= asked.until_ns, lasted(intervals, asked.since_ns)
        )
        rows, at_ns = await self._page(query, order, limit, after)
        return [interval_of_row(row, at_ns) for row in rows]

    async def alerts(
        self, asked: Asked, limit: int, after: AlertPlace | None = None, *, states: Sequence[AlertState] = ()
    ) -> list[Alert]:
        """Return the alerts that changed last, in one of the states if any are named."""
        query = alerts.select().where(
            *_named(asked, alerts), alerts.c.raised_ns <= asked.until_ns, alerts.c.changed_ns >= asked.since_ns
        )
        if states:
            query = query.where(alerts.c.state.in_(states))
        rows, _ = await self._page(query, (alerts.c.changed_ns, alerts.c.id), limit, after)
        return [alert_of_row(row) for row in rows]

    async def acts(self, alert_ids: Sequence[str]) -> list[Act]:
        """Return what was done with some alerts, in order."""
        query = acts.select().where(acts.c.alert_id.in_(alert_ids[:MAX_ROWS])).order_by(acts.c.at_ns).limit(MAX_ROWS)
        rows, _ = await self._read(query)
        return [act_of_row(row) for row in rows]

    async def _page(
        self, query: Select[Any], order: Sequence[Any], limit: int, after: tuple[Any, ...] | None
    ) -> tuple[Sequence[Any], int]:
        if after is not None:
            query = query.where(tuple_(*order) < tuple_(*after))
        return await self._read(query.order_by(*(each.desc() for each in order)).limit(min(limit, MAX_ROWS)))

    async def _read(self, query: Select[Any]) -> tuple[Sequence[Any], int]:
        """Return the rows, and when somebody wrote last."""
        if self._url == NONE:
            raise HistoryError("no history is kept: the monitor was started with --history none")
        async with self._room, translating():
            connection = await connect(engine_of(self._url), create=False)
            try:
                rows = (await connection.execute(query)).all()
                at_ns = await connection.scalar(select(heartbeat.c.at_ns))
            finally:
                await connection.close()
        return rows, at_ns or 0


def _named(asked: Asked, table: Table) -> list[ColumnElement[bool]]:
    given = {"robot": asked.robot, "camera": asked.camera, "name": asked.name}
    return [table.c[column] == value for column, value in given.items() if value]
