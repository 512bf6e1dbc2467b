"""Figures beside what was aimed at. Pure."""

from collections.abc import Mapping
from typing import Any


def at_most(found: Mapping[str, Any], name: str, limit: float) -> dict[str, dict[str, Any]]:
    """Return a figure's target and whether it is met."""
    return {name: {"value": found[name], "at_most": limit, "met": found[name] <= limit}}


def at_least(found: Mapping[str, Any], name: str, limit: float) -> dict[str, dict[str, Any]]:
    """Return a figure's target and whether it is met."""
    return {name: {"value": found[name], "at_least": limit, "met": found[name] >= limit}}
