"""Rows of the history: converts them from and to objects, writes them, and finds the newest of each place."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Final, TypeVar

import msgspec
from sqlalchemy import (
    CTE,
    BigInteger,
    ColumnElement,
    Row,
    ScalarSelect,
    Select,
    Table,
    and_,
    func,
    literal,
    select,
    tuple_,
)
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import Dialect

from schemas.alerts import Alert, AlertState
from schemas.keys import CameraKey, check_name
from services.monitor.history.interval_buffer import StoredInterval
from services.monitor.history.intervals import Disagreement, Interval
from services.monitor.history.presence import Presence
from services.monitor.history.state import Act
from services.monitor.history.tables import (
    alert_objects,
    alerts,
    disagreements,
    intervals,
    object_events,
    presence,
    stock,
)
from services.monitor.history.world_history import ObjectEvent, StockLevel
from services.monitor.map.pose import Pose

L = TypeVar("L", bound=StoredInterval)

TABLES: Final[Mapping[type[StoredInterval], Table]] = {
    Interval: intervals,
    Presence: presence,
    Disagreement: disagreements,
    StockLevel: stock,
    ObjectEvent: object_events,
}
"""Where each kind of intervals is kept; its columns are their fields, and those of a key."""


def row_of_interval(of: StoredInterval) -> dict[str, Any]:
    """Return an interval's columns."""
    columns = _storable(msgspec.structs.asdict(of))
    if (key := columns.pop("key", None)) is not None:
        columns |= {"robot": key.robot, "camera": key.camera}
    return columns


def interval_of_row(kind: type[L], row: Row[Any], heartbeat_ns: int = 0) -> L:
    """Return the interval of a row; an open one lasts until the heartbeat.

    Raises:
        SchemaError: names that nobody can have.
    """
    columns = _columns(row)
    if columns["open"]:
        columns["until_ns"] = max(columns["until_ns"], heartbeat_ns)
    if kind in (StockLevel, ObjectEvent):
        check_name("site", columns["site"])
    elif kind is Presence:
        for role in ("robot", "camera"):
            if columns[role]:
                check_name(role, columns[role])
    else:
        columns["key"] = CameraKey(columns.pop("robot"), columns.pop("camera"))
    return kind(**columns)


def row_of_pose(robot: str, pose: Pose) -> dict[str, Any]:
    """Return the columns of a robot's pose."""
    return {"robot": robot, "x": pose.x, "y": pose.y, "yaw": pose.yaw, "at_ns": pose.at_ns}


def pose_of_row(row: Row[Any]) -> tuple[str, Pose]:
    """Return the robot of a row, and its pose."""
    check_name("robot", row.robot)
    return row.robot, Pose(row.x, row.y, row.yaw, row.at_ns)


def row_of_alert(alert: Alert) -> dict[str, Any]:
    """Return an alert's columns in its table; `alert_objects` has what it is about."""
    columns = _storable(msgspec.to_builtins(alert))
    return {name: value for name, value in columns.items() if name in alerts.c}


def row_of_alert_object(alert: Alert) -> dict[str, Any]:
    """Return the columns that say which site and object an alert is about."""
    return {"alert_id": alert.id, "site": alert.site, "object": storable(alert.object)}


def alert_of_row(row: Row[Any]) -> Alert:
    """Return the alert of a row, with its site and object where these are known."""
    return msgspec.convert({name: value for name, value in _columns(row).items() if value is not None}, Alert)


def select_alerts(*more: ColumnElement[Any]) -> Select[Any]:
    """Return a query for alerts with their sites and objects, and for more columns."""
    of = alert_objects.c
    return select(*alerts.c, of.site, of.object, *more).outerjoin_from(
        alerts, alert_objects, of.alert_id == alerts.c.id
    )


def row_of_act(act: Act) -> dict[str, Any]:
    """Return an act's columns."""
    return {"alert_id": act.alert_id, "at_ns": act.at_ns, "state": act.state, "who": storable(act.who)}


def act_of_row(row: Row[Any]) -> Act:
    """Return the act of a row."""
    return Act(row.alert_id, AlertState(row.state), row.who, row.at_ns)


def _columns(row: Row[Any]) -> dict[str, Any]:
    return dict(zip(map(str, row._fields), row, strict=True))


def _storable(columns: dict[str, Any]) -> dict[str, Any]:
    return {name: storable(value) if isinstance(value, str) else value for name, value in columns.items()}


def storable(text: str) -> str:
    """Return a text with NUL replaced, which PostgreSQL refuses."""
    return text.replace("\0", "\N{SYMBOL FOR NULL}")


@dataclass(frozen=True, slots=True)
class Upsert:
    """The statement that inserts or replaces rows of a table. values: of a row, in the statement's order."""

    statement: str
    values: Callable[[Mapping[str, Any]], tuple[Any, ...]]


def upsert_of(table: Table, dialect: Dialect) -> Upsert:
    """Return the upsert statement of a table with more than one column."""
    statement = (sqlite if dialect.name == "sqlite" else postgresql).insert(table)
    keys = [column.name for column in table.primary_key]
    others = {column.name: statement.excluded[column.name] for column in table.columns if column.name not in keys}
    compiled = statement.on_conflict_do_update(index_elements=keys, set_=others).compile(dialect=dialect)
    names = [column.name for column in table.columns] if compiled.positiontup is None else compiled.positiontup
    return Upsert(str(compiled), itemgetter(*names))


FOREVER_NS: Final = 2**63 - 1


def places_of(table: Table) -> CTE:
    """Return the places of a table, without those whose first name is empty, and one row of nulls.

    A place is all of the primary key but since_ns, its end. From each to the next it takes a step in the key's index.
    """
    names = [column.name for column in table.primary_key if column.name != "since_ns"]
    at = select(*(literal("").label(name) for name in names)).cte(recursive=True)
    later = table.alias()
    order = [*(later.c[name] for name in names), later.c.since_ns]
    last = [*(at.c[name] for name in names), literal(FOREVER_NS, BigInteger)]

    def of_next(name: str) -> ScalarSelect[Any]:
        found = select(later.c[name]).where(tuple_(*order) > tuple_(*last))
        return found.order_by(*order).limit(1).scalar_subquery()

    return at.union_all(select(*map(of_next, names)).where(at.c[names[0]].is_not(None)))


def newest_of_each(table: Table) -> Select[Any]:
    """Return a query for the newest interval of each place; see `places_of`."""
    at, others = places_of(table), table.alias()
    names = [column.name for column in at.c]
    newest = select(func.max(others.c.since_ns)).where(*(others.c[name] == at.c[name] for name in names))
    here = and_(*(table.c[name] == at.c[name] for name in names), table.c.since_ns == newest.scalar_subquery())
    return select(table).select_from(at).join(table, here).where(at.c[names[0]] != "")
