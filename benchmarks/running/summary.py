"""What was found, for a person to read at the end. Pure."""

from collections.abc import Iterator, Mapping
from typing import Any


def outcome(record: Mapping[str, Any]) -> str:
    """Return how many of a benchmark's targets are met."""
    targets = record["targets"]
    met = sum(target["met"] for target in targets.values())
    return f"{met} of {len(targets)} targets met" if targets else "measured"


def missed(record: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line about each target that is not met."""
    for name, target in record["targets"].items():
        if not target["met"]:
            yield f"{record['benchmark']}: {name} is {_found(target)}, not {_limit(target)}{_ceiling(target)}"


def _found(target: Mapping[str, Any]) -> str:
    value = target["ratio"] if "ratio" in target else target["value"]
    if isinstance(value, Mapping):
        return f"{value['median']:g} ({value['min']:g} to {value['max']:g})"
    return f"{value:g}" if isinstance(value, int | float) else "unknown"


def _limit(target: Mapping[str, Any]) -> str:
    return f"at least {target['at_least']:g}" if "at_least" in target else f"at most {target['at_most']:g}"


def _ceiling(target: Mapping[str, Any]) -> str:
    if "ceiling" not in target:
        return ""
    ceiling = target["ceiling"]
    value = ceiling["median"] if isinstance(ceiling, Mapping) else ceiling
    return f"; nothing here can pass {value:g}" if isinstance(value, int | float) else ""
