"""Figures as they are printed. Pure."""

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.targets import Targets, at_least, at_most


def medians(speeds: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """Return the median of each speed over its repeats, and under `spread` the least and the greatest."""
    return {
        **{name: round(statistics.median(values), 2) for name, values in speeds.items()},
        "spread": {name: [round(min(values), 2), round(max(values), 2)] for name, values in speeds.items()},
    }


def overhead(milliseconds: Sequence[float]) -> dict[str, float]:
    """Return the median and the 99th percentile."""
    ordered = sorted(milliseconds)
    return {
        "overhead_p50_ms": round(statistics.median(ordered), 2),
        "overhead_p99_ms": round(ordered[min(len(ordered) - 1, int(len(ordered) * 0.99))], 2),
        "overhead_samples": len(ordered),
    }


def targets(found: Mapping[str, Any]) -> Targets:
    """Return each target: the ratio or value, its limit, and whether it is met."""
    return {
        **at_least(found, "worker_fps", 0.9, "bare_fps"),
        **at_least(found, "torch_fps", 0.9, "bare_torch_fps"),
        **at_least(found, "auto_fps", 1.3, "torch_fps"),
        **at_most(found, "overhead_p50_ms", 6),
        **at_most(found, "overhead_p99_ms", 25),
        **at_most(found, "rss_growth_mb", 20),
    }
