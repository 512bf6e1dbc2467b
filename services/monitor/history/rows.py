"""Converts between objects and rows of the history."""

from collections.abc import Mapping
from typing import Any, Final, TypeVar

import msgspec
from sqlalchemy import Row, Table

from schemas.alerts import Alert, AlertState
from schemas.keys import CameraKey, check_name
from services.monitor.history.intervals import Disagreement, Interval
from services.monitor.history.ledger import StoredInterval
from services.monitor.history.presence import Presence
from services.monitor.history.state import Act
from services.monitor.history.tables import disagreements, intervals, presence
from services.monitor.map.pose import Pose

L = TypeVar("L", bound=StoredInterval)

TABLES: Final[Mapping[type[StoredInterval], Table]] = {
    Interval: intervals,
    Presence: presence,
    Disagreement: disagreements,
}
"""Where each kind of intervals is kept; its columns are their fields, and those of a key."""


def row_of_lasting(of: StoredInterval) -> dict[str, Any]:
    """Return an interval's columns."""
    columns = _storable(msgspec.structs.asdict(of))
    if (key := columns.pop("key", None)) is not None:
        columns |= {"robot": key.robot, "camera": key.camera}
    return columns


def lasting_of_row(kind: type[L], row: Row[Any], heartbeat_ns: int = 0) -> L:
    """Return the interval of a row; an open one lasts until the heartbeat.

    Raises:
        SchemaError: names that nobody can have.
    """
    columns = _columns(row)
    if columns["open"]:
        columns["until_ns"] = max(columns["until_ns"], heartbeat_ns)
    if kind is Presence:
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
    """Return an alert's columns."""
    return _storable(msgspec.to_builtins(alert))


def alert_of_row(row: Row[Any]) -> Alert:
    """Return the alert of a row."""
    return msgspec.convert(_columns(row), Alert)


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
