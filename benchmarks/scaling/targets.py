"""Figures beside what was aimed at. Pure."""

from collections.abc import Mapping
from typing import Any

from benchmarks.scaling.scenario import FRAME_MS, LEASE_S
from benchmarks.targets import Targets, at_least, at_most

AT_LEAST = {"efficiency_8": 0.95, "useful_fraction": 0.9}
AT_MOST = {
    "double_owned": 0,
    "unowned": 0,
    "max_share": 2.5,
    "failover_s": 0.5,
    "moved_others": 0,
    "hang_failover_s": LEASE_S + 1,
    "woken_double_s": 0.5,
    "join_gap_s": 0.3,
    "rolling_gap_s": 1,
    "max_age_ms": 2 * FRAME_MS + 50,
}


def targets(found: Mapping[str, Any]) -> Targets:
    """Return each target and whether it is met."""
    made: Targets = {}
    for name, limit in AT_LEAST.items():
        made |= at_least(found, name, limit)
    for name, limit in AT_MOST.items():
        made |= at_most(found, name, limit)
    return made
