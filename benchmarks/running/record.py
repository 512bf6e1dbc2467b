"""What is kept of a benchmark: what all of its runs found, on what, and whether that was aimed at. Pure."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

ABOUT: Final = ("machine", "versions", "seeds")
"""What says under which circumstances the rest was found."""

DIGITS: Final = 6


@dataclass(frozen=True, slots=True)
class Run:
    """What one run found, how long it took, and the machine's load average before it."""

    found: Mapping[str, Any]
    seconds: float
    load: float


def record(name: str, command: str, date: str, commit: str, runs: Sequence[Run]) -> dict[str, Any]:
    """Return what is kept of a benchmark that ran at least once.

    A figure that differs between runs becomes its least, its median and its greatest value.
    """
    found = [run.found for run in runs]
    about = {what: merged([each[what] for each in found]) for what in ABOUT if what in found[0]}
    return {
        "benchmark": name,
        "command": command,
        "date": date,
        "commit": commit,
        **about,
        "runs": len(runs),
        "seconds": merged([round(run.seconds, 1) for run in runs]),
        "load_average_before": merged([round(run.load, 2) for run in runs]),
        "targets": targets([each.get("targets", {}) for each in found]),
        "figures": merged(
            [{what: value for what, value in each.items() if what not in {*ABOUT, "targets"}} for each in found]
        ),
    }


def merged(values: Sequence[Any]) -> Any:
    """Return one value in the place of that of each run."""
    first = values[0]
    if all(value == first for value in values):
        return first
    if all(map(_is_number, values)):
        return {"min": min(values), "median": round(statistics.median(values), DIGITS), "max": max(values)}
    if all(isinstance(value, Mapping) for value in values):
        keys = dict.fromkeys(key for value in values for key in value)
        return {key: merged([value[key] for value in values if key in value]) for key in keys}
    if all(isinstance(value, list) and len(value) == len(first) for value in values):
        return [merged(column) for column in zip(*values, strict=True)]
    return list(values)


def middle(value: Any) -> float:
    """Return the median of a figure, whether or not it differs between runs.

    Raises:
        ValueError: it is no figure.
    """
    found: Any = value.get("median") if isinstance(value, Mapping) else value
    if not _is_number(found):
        raise ValueError(f"no figure: {str(value)[:80]}")
    return float(found)


def targets(runs: Sequence[Mapping[str, Mapping[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Return each target of all runs: what was found, the limit, whether the median met it, and how many runs did."""
    return {name: _target([run[name] for run in runs if name in run]) for name in runs[0]}


def _target(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    both = dict(merged(runs))
    values = [run["ratio"] if "ratio" in run else run["value"] for run in runs]
    both["met"] = None not in values and _meets(statistics.median(values), runs[0])
    return {**both, "runs_met": sum(bool(run["met"]) for run in runs)}


def _meets(value: float, target: Mapping[str, Any]) -> bool:
    return bool(value >= target["at_least"] if "at_least" in target else value <= target["at_most"])


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
