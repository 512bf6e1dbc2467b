"""What was aimed at, beside what was measured. Pure."""

from collections.abc import Mapping
from typing import Any

Targets = dict[str, dict[str, Any]]


def at_least(found: Mapping[str, Any], name: str, other: str, limit: float, ceiling: str | None = None) -> Targets:
    """Return whether one figure is at least `limit` times another. ceiling: the figure that none can pass."""
    ratio = round(found[name] / found[other], 3)
    target: dict[str, Any] = {"ratio": ratio, "at_least": limit, "met": ratio >= limit}
    if ceiling is not None:
        target["ceiling"] = round(found[ceiling] / found[other], 3)
    return {f"{name} / {other}": target}


def at_most(found: Mapping[str, Any], name: str, limit: float, other: str | None = None) -> Targets:
    """Return whether a figure is at most `limit`, or `limit` times another."""
    if other is None:
        return {name: {"value": found[name], "at_most": limit, "met": found[name] <= limit}}
    ratio = round(found[name] / found[other], 3)
    return {f"{name} / {other}": {"ratio": ratio, "at_most": limit, "met": ratio <= limit}}
