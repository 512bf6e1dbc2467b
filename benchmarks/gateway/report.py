"""Medians, their spread, and whether they are what was aimed at. Pure."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

from benchmarks.gateway.flow import Figure, Variant
from benchmarks.targets import Targets, at_least, at_most

CEILING: Final = "tcpros_only_frames_per_s"


@dataclass(frozen=True, slots=True)
class Run:
    """What was measured: a variant at `hz` frames a second, or flat out if that is 0."""

    variant: Variant
    hz: int
    shared_memory: bool

    def __str__(self) -> str:
        pace = f"at {self.hz} Hz" if self.hz else "flat out"
        return f"{self.variant} {pace}, {'with' if self.shared_memory else 'without'} shared memory"

    def named(self, figure: str) -> str:
        """Return the name of one of its figures; the gateway's own have no prefix."""
        prefix = "" if self.variant == "fleetsight" else f"{self.variant}_"
        pace = f"_{self.hz}hz" if self.hz else ""
        return f"{prefix}{figure}{pace}{_memory(shared_memory=self.shared_memory)}"


def _memory(*, shared_memory: bool) -> str:
    return "" if shared_memory else "_no_shm"


def medians(runs: Mapping[Run, Sequence[Figure]]) -> dict[str, Any]:
    """Return the median of each figure over a run's repeats, and under `spread` the least and the greatest."""
    found: dict[str, Any] = {}
    spread: dict[str, list[float]] = {}
    for run, repeats in runs.items():
        for field in fields(Figure):
            values = [value for figure in repeats if (value := getattr(figure, field.name)) is not None]
            if values:
                name = run.named(field.name)
                found[name] = round(statistics.median(values), 3)
                spread[name] = [round(min(values), 3), round(max(values), 3)]
    for ending in ("", "_no_shm"):
        hop = found[f"zenoh_only_latency_p50_ms_30hz{ending}"]
        found[f"added_latency_p50_ms{ending}"] = round(found[f"gateway_latency_p50_ms_30hz{ending}"] - hop, 3)
    return {**found, "spread": spread}


def targets(found: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return each target: the ratio or value, its limit, and whether it is met.

    ceiling: the ratio that tcpros_only has, which no gateway can pass. floor: the one that bare_gateway has, the least.
    """
    return (
        {
            name: target
            for ending in ("", "_no_shm")
            for name, target in {
                **at_least(found, f"frames_per_s{ending}", 3, f"rospy_naive_frames_per_s{ending}"),
                **at_least(found, f"frames_per_s{ending}", 0.8, f"zenoh_only_frames_per_s{ending}", CEILING),
                **at_least(found, f"frames_per_s{ending}", 0.8, f"bare_gateway_frames_per_s{ending}"),
                **_cost(found, ending, 0.3),
                **_cost(found, f"_30hz{ending}", 0.4),
                **at_most(found, f"added_latency_p50_ms{ending}", 1.5),
                **at_most(found, f"peak_frames_buffered{ending}", 3),
                **at_most(found, f"stalled_rss_growth_mb{ending}", 10),
            }.items()
        }
        | at_most(found, "idle_cpu_percent", 1)
        | at_most(found, "idle_bytes", 0)
    )


def _cost(found: Mapping[str, Any], ending: str, limit: float) -> Targets:
    name = f"cpu_ms_per_frame{ending}"
    return at_most(found, name, limit, f"rospy_naive_{name}", floor=f"bare_gateway_{name}")
