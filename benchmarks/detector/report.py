"""Figures as they are printed. Pure."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Self

from benchmarks.targets import Targets, at_least, at_most
from schemas.header import Spans

MODEL: Final = "model"
"""The span of a result that is the model's call."""


def medians(speeds: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """Return the median of each speed over its repeats, and under `spread` the least and the greatest."""
    return {
        **{name: round(statistics.median(values), 2) for name, values in speeds.items()},
        "spread": {name: [round(min(values), 2), round(max(values), 2)] for name, values in speeds.items()},
    }


@dataclass(frozen=True, slots=True)
class Overhead:
    """A frame's way to its class list in milliseconds, less the model's call. stages: what it was spent on."""

    milliseconds: float
    stages: Mapping[str, float]

    @classmethod
    def of(cls, took_ns: int, spans: Spans) -> Self:
        """Take the model's call off; what no stage took was spent on the bus and between threads."""
        stages = {name: ns / 1e6 for name, ns in spans.items() if name != MODEL}
        whole = (took_ns - spans[MODEL]) / 1e6
        return cls(whole, {**stages, "bus": whole - sum(stages.values())})


def overhead(found: Sequence[Overhead]) -> dict[str, Any]:
    """Return the median, that of each stage, and the 99th percentile."""
    ordered = sorted(each.milliseconds for each in found)
    return {
        "overhead_p50_ms": round(statistics.median(ordered), 2),
        "overhead_p99_ms": round(ordered[min(len(ordered) - 1, int(len(ordered) * 0.99))], 2),
        "overhead_stages_ms": {
            name: round(statistics.median(each.stages[name] for each in found), 2) for name in found[0].stages
        },
        "overhead_samples": len(ordered),
    }


def targets(found: Mapping[str, Any]) -> Targets:
    """Return each target: the ratio or value, its limit, and whether it is met."""
    return {
        **at_least(found, "worker_fps", 0.9, "bare_fps"),
        **at_least(found, "auto_fps", 1.8, "bare_fps"),
        **at_least(found, "torch_fps", 0.9, "bare_torch_fps"),
        **at_least(found, "auto_fps", 1.3, "torch_fps"),
        **at_most(found, "overhead_p50_ms", 6),
        **at_most(found, "overhead_p99_ms", 25),
        **at_most(found, "rss_mb", 600),
        **at_most(found, "rss_growth_mb", 20),
    }
