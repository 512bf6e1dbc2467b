"""What was aimed at, beside what was measured. Pure.

A figure that could not be measured, None, meets no target.
"""

from collections.abc import Mapping
from typing import Any

Targets = dict[str, dict[str, Any]]


def at_least(
    found: Mapping[str, Any], name: str, limit: float, other: str | None = None, ceiling: str | None = None
) -> Targets:
    """Return whether a figure is at least `limit`, or `limit` times another. ceiling: the figure that none can pass."""
    value = _value(found, name, other)
    target = {**_named(value, other), "at_least": limit, "met": value is not None and value >= limit}
    if ceiling is not None:
        target["ceiling"] = _value(found, ceiling, other)
    return {_title(name, other): target}


def at_most(
    found: Mapping[str, Any], name: str, limit: float, other: str | None = None, floor: str | None = None
) -> Targets:
    """Return whether a figure is at most `limit`, or `limit` times another. floor: the least that there was of it."""
    value = _value(found, name, other)
    target = {**_named(value, other), "at_most": limit, "met": value is not None and value <= limit}
    if floor is not None:
        target["floor"] = _value(found, floor, other)
    return {_title(name, other): target}


def _value(found: Mapping[str, Any], name: str, other: str | None) -> float | None:
    value: float | None = found[name]
    if other is None or value is None:
        return value
    return None if not found[other] else round(value / found[other], 3)


def _named(value: float | None, other: str | None) -> dict[str, Any]:
    return {"value" if other is None else "ratio": value}


def _title(name: str, other: str | None) -> str:
    return name if other is None else f"{name} / {other}"
