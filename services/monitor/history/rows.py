"""What is kept as rows, and back. Pure."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

import msgspec
from sqlalchemy import Row, Table

from schemas.alerts import Alert, AlertState
from schemas.keys import CameraKey, check_name
from services.monitor.history.acts import Act
from services.monitor.history.disagreements import Disagreement
from services.monitor.history.intervals import Interval
from services.monitor.history.ledger import Lasting
from services.monitor.history.presence import Presence
from services.monitor.history.tables import disagreements, intervals, presence
from services.monitor.mapping.pose import Pose

L = TypeVar("L", bound=Lasting)


@dataclass(frozen=True, slots=True)
class Kind(Generic[L]):
    """Where one kind of intervals is kept, and how. of_row: an open one goes on until the heartbeat, which it takes."""

    table: Table
    row_of: Callable[[L], Mapping[str, Any]]
    of_row: Callable[[Row[Any], int], L]


def row_of_interval(interval: Interval) -> dict[str, Any]:
    """Return an interval's columns."""
    return {
        "robot": interval.key.robot,
        "camera": interval.key.camera,
        "name": storable(interval.name),
        "since_ns": interval.since_ns,
        "until_ns": interval.until_ns,
        "open": interval.open,
        "count": interval.count,
        "score": interval.score,
        "closest_m": interval.closest_m,
        "first_ns": interval.first_ns,
        "model": storable(interval.model),
        "worker": storable(interval.worker),
    }


def interval_of_row(row: Row[Any], heartbeat_ns: int = 0) -> Interval:
    """Return the interval of a row; an open one goes on until the heartbeat."""
    columns = _lasting(row, heartbeat_ns)
    return Interval(key=_key(columns), **columns)


def row_of_presence(there: Presence) -> dict[str, Any]:
    """Return the columns of who was there."""
    return {
        "robot": there.robot,
        "camera": there.camera,
        "since_ns": there.since_ns,
        "until_ns": there.until_ns,
        "open": there.open,
        "heard_ns": there.heard_ns,
    }


def presence_of_row(row: Row[Any], heartbeat_ns: int = 0) -> Presence:
    """Return who a row says was there.

    Raises:
        SchemaError: names that nobody can have.
    """
    for role, name in (("robot", row.robot), ("camera", row.camera)):
        if name:
            check_name(role, name)
    return Presence(**_lasting(row, heartbeat_ns))


def row_of_disagreement(of: Disagreement) -> dict[str, Any]:
    """Return a disagreement's columns."""
    return {
        "robot": of.key.robot,
        "camera": of.key.camera,
        "name": storable(of.name),
        "since_ns": of.since_ns,
        "until_ns": of.until_ns,
        "open": of.open,
        "count": of.count,
        "model": storable(of.model),
        "other_count": of.other_count,
        "other_model": storable(of.other_model),
    }


def disagreement_of_row(row: Row[Any], heartbeat_ns: int = 0) -> Disagreement:
    """Return the disagreement of a row."""
    columns = _lasting(row, heartbeat_ns)
    return Disagreement(key=_key(columns), **columns)


def row_of_pose(robot: str, pose: Pose) -> dict[str, Any]:
    """Return the columns of where a robot is."""
    return {"robot": robot, "x": pose.x, "y": pose.y, "yaw": pose.yaw, "at_ns": pose.at_ns}


def pose_of_row(row: Row[Any]) -> tuple[str, Pose]:
    """Return the robot of a row, and where it is."""
    check_name("robot", row.robot)
    return row.robot, Pose(row.x, row.y, row.yaw, row.at_ns)


KINDS: Final[Mapping[type[Lasting], Kind[Any]]] = {
    Interval: Kind(intervals, row_of_interval, interval_of_row),
    Presence: Kind(presence, row_of_presence, presence_of_row),
    Disagreement: Kind(disagreements, row_of_disagreement, disagreement_of_row),
}


def row_of_alert(alert: Alert) -> dict[str, Any]:
    """Return an alert's columns."""
    columns = msgspec.to_builtins(alert)
    return {name: storable(value) if isinstance(value, str) else value for name, value in columns.items()}


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


def _lasting(row: Row[Any], heartbeat_ns: int) -> dict[str, Any]:
    """Return the columns of an interval; what is open goes on until the heartbeat."""
    columns = _columns(row)
    if columns["open"]:
        columns["until_ns"] = max(columns["until_ns"], heartbeat_ns)
    return columns


def _key(columns: dict[str, Any]) -> CameraKey:
    return CameraKey(columns.pop("robot"), columns.pop("camera"))


def storable(text: str) -> str:
    """Return a text as PostgreSQL takes it: without NUL."""
    return text.replace("\0", "\N{SYMBOL FOR NULL}")
