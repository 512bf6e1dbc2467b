"""Intervals and alerts as rows, and back. Pure."""

from typing import Any

import msgspec
from sqlalchemy import Row

from schemas.alerts import Alert, AlertState
from schemas.keys import CameraKey
from services.monitor.history.acts import Act
from services.monitor.history.intervals import Interval


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
    columns = _columns(row)
    key = CameraKey(columns.pop("robot"), columns.pop("camera"))
    if columns["open"]:
        columns["until_ns"] = max(columns["until_ns"], heartbeat_ns)
    return Interval(key=key, **columns)


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
    return {str(name): value for name, value in row._mapping.items()}  # noqa: SLF001 - SQLAlchemy's documented name


def storable(text: str) -> str:
    """Return a text as PostgreSQL takes it: without NUL."""
    return text.replace("\0", "\N{SYMBOL FOR NULL}")
