"""Figures as they are printed. Pure."""

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from benchmarks.targets import Targets, at_least, at_most

SETS: Final = {
    "guide": "guide_sets_per_s_torch",
    "fleetsight_torch": "fleetsight_sets_per_s_torch",
    "fleetsight_best": "fleetsight_sets_per_s_best",
}
"""What the rate of each side is called."""
AGES: Final = {
    "guide": "guide_age_p50_ms_1hz",
    "fleetsight_torch": "fleetsight_torch_age_p50_ms_1hz",
    "fleetsight_best": "fleetsight_age_p50_ms_1hz",
}


@dataclass(frozen=True, slots=True)
class Run:
    """A side driven for so long. sets: whole ones. cpu_s: processor time of each of its processes.

    shares: of how many sets each process did its share, where processes do not work on the same sets.
    ages_ms: of the sets. others_cores: how many cores were busy with neither side nor benchmark.
    """

    seconds: float
    sets: int
    cpu_s: Mapping[str, float]
    shares: Mapping[str, int]
    ages_ms: Sequence[float]
    others_cores: float

    @property
    def cpu_ms_per_set(self) -> float | None:
        """Processor time of all its processes for a set; None if one of them did nothing for any."""
        done = [self.shares.get(name, self.sets) for name in self.cpu_s]
        if not all(done):
            return None
        return sum(spent * 1000 / sets for spent, sets in zip(self.cpu_s.values(), done, strict=True))

    @property
    def balanced_sets_per_s(self) -> float | None:
        """How many sets a second its processor time is worth, were it spread over the processes as sets need it."""
        each = self.cpu_ms_per_set
        return sum(self.cpu_s.values()) * 1000 / each / self.seconds if each else None


@dataclass(frozen=True, slots=True)
class Runs:
    """All runs of a side: flooded, and at a rate at which nothing queues."""

    flooded: list[Run] = field(default_factory=list)
    slow: list[Run] = field(default_factory=list)


def figures(sides: Mapping[str, Runs]) -> dict[str, Any]:
    """Return each side's figures, and under `spread` the least and the greatest of its repeats."""
    found: dict[str, Any] = {}
    spread: dict[str, Any] = {}
    for name, runs in sides.items():
        rates = [run.sets / run.seconds for run in runs.flooded]
        found[SETS[name]] = round(statistics.median(rates), 2)
        spread[SETS[name]] = [round(min(rates), 2), round(max(rates), 2)]
        ages = sorted(age for run in runs.slow for age in run.ages_ms)
        found[AGES[name]] = round(statistics.median(ages), 1) if ages else None
        spread[AGES[name]] = [round(ages[0], 1), round(ages[-1], 1)] if ages else None
        found[f"{name}_balanced_sets_per_s"] = _median((run.balanced_sets_per_s for run in runs.flooded), 2)
        found[f"{name}_cpu_ms_per_set"] = _median(run.cpu_ms_per_set for run in runs.flooded)
        found[f"{name}_cpu_ms_per_set_1hz"] = _median(run.cpu_ms_per_set for run in runs.slow)
        found[f"{name}_cpu_ms_per_set_1hz_by_process"] = _by_process(runs.slow)
    everything = [run for runs in sides.values() for run in (*runs.flooded, *runs.slow)]
    busy = round(statistics.median(run.others_cores for run in everything), 2)
    return {**found, "spread": spread, "cores_busy_elsewhere": busy}


def _median(values: Iterable[float | None], digits: int = 1) -> float | None:
    known = [value for value in values if value is not None]
    return round(statistics.median(known), digits) if known else None


def _by_process(runs: Sequence[Run]) -> dict[str, float | None]:
    return {name: _of_process(runs, name) for name in (runs[0].cpu_s if runs else ())}


def _of_process(runs: Sequence[Run], name: str) -> float | None:
    sets = sum(run.shares.get(name, run.sets) for run in runs)
    return round(sum(run.cpu_s[name] for run in runs) * 1000 / sets, 1) if sets else None


def targets(found: Mapping[str, Any]) -> Targets:
    """Return each target: the ratio, its limit, and whether it is met."""
    return {
        **at_least(found, SETS["fleetsight_torch"], 4, SETS["guide"]),
        **at_least(found, SETS["fleetsight_best"], 6, SETS["guide"]),
        **at_most(found, AGES["fleetsight_best"], 0.333, AGES["guide"]),
    }
