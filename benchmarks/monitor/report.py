"""What became of class lists, and whether it is what was aimed at. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

from benchmarks.targets import Targets, at_most

AT_MOST = {"lost": 0, "p99_ms": 50, "rss_mb": 600, "page_p95_ms": 200, "cpu_share_1000x5": 0.35}


@dataclass(frozen=True, slots=True)
class Flow:
    """What became of the class lists of some seconds.

    latencies_ms: from putting a list on the bus until an answer of the inventory shows it. cpu_share: of one core.
    pages_ms: how long whole answers of the page and of the API took, by path; inf where it was an error.
    late_ms: how late the latest list was handed to the bus. Nobody looked if there are no latencies and pages.
    """

    lost: int
    sent_per_s: float
    latencies_ms: Sequence[float]
    pages_ms: Mapping[str, Sequence[float]]
    cpu_share: float
    late_ms: float

    def figures(self) -> dict[str, Any]:
        """Return what is printed."""
        sent = {
            "lost": self.lost,
            "msgs_per_s": round(self.sent_per_s),
            "cpu_share": round(self.cpu_share, 3),
            "publishers_late_ms": self.late_ms,
        }
        return sent | (self._seen() if self.latencies_ms and self.pages_ms else {})

    def _seen(self) -> dict[str, Any]:
        return {
            "p50_ms": percentile(self.latencies_ms, 50),
            "p99_ms": percentile(self.latencies_ms, 99),
            "probes": len(self.latencies_ms),
            "page_p95_ms": max(percentile(times, 95) for times in self.pages_ms.values()),
            "p95_ms_by_path": {path: percentile(times, 95) for path, times in self.pages_ms.items()},
        }


def percentile(values: Sequence[float], percent: int) -> float:
    """Return the least value that so many are at most."""
    return round(sorted(values)[ceil(len(values) * percent / 100) - 1], 1)


def targets(found: Mapping[str, Any]) -> Targets:
    """Return each target and whether it is met."""
    made: Targets = {}
    for name, limit in AT_MOST.items():
        made |= at_most(found, name, limit)
    return made
