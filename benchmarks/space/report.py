"""Figures as they are printed. Pure."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from benchmarks.targets import Targets, at_least, at_most

Values = Mapping[str, Sequence[float]]
TARGETS: Final = {
    "distance_mae_rel_gt_masks": 0.005,
    "distance_mae_rel": 0.02,
    "distance_p99_rel": 0.08,
    "distance_mae_rel_unregistered": 0.025,
    "centroid_excess_m": 0.0,
    "box_extent_rel": 0.10,
    "foreign_points": 0.01,
    "map_spread_m": 0.10,
    "distance_ms_p50": 3.0,
    "cloud_ms_p50": 10.0,
    "lidar_ms_p50": 15.0,
}
TIMES_FASTER: Final = 5.0


def report(samples: Values, wall_ms: Values, cpu_ms: Values) -> dict[str, Any]:
    """Return the figures by the names that the targets have, what is beside them, and which targets are met.

    samples: a value for each object, by what was measured. wall_ms, cpu_ms: one for each time that it was done.
    """
    figures = {
        "distance_mae_rel_gt_masks": _mean(samples["distance_gt_masks"]),
        "distance_mae_rel": _mean(samples["distance"]),
        "distance_p99_rel": _percentile(samples["distance"], 99),
        "guide_distance_mae_rel": _mean(samples["guide_distance"]),
        "guide_distance_mae_rel_metres": _mean(samples["guide_distance_metres"]),
        "distance_mae_rel_unregistered": _mean(samples["distance_unregistered"]),
        "centroid_excess_m": _percentile(samples["centroid_excess"], 95),
        "centroid_excess_m_worst": max(samples["centroid_excess"]),
        "centroids_over": _mean([float(excess > 0) for excess in samples["centroid_excess"]]),
        "box_extent_rel": _mean(samples["box_extent"]),
        "foreign_points": _mean(samples["foreign_points"]),
        "map_spread_m": _mean(samples["map_spread"]),
        **{f"{name}_ms_p50": _percentile(values, 50) for name, values in wall_ms.items()},
        **{f"{name}_cpu_ms_p50": _percentile(values, 50) for name, values in cpu_ms.items()},
    }
    figures = {name: round(value, 4) for name, value in figures.items()}
    targets: Targets = {}
    for name, limit in TARGETS.items():
        targets |= at_most(figures, name, limit)
    targets |= at_least(figures, "guide_cloud_ms_p50", TIMES_FASTER, "cloud_ms_p50")
    return {"targets": targets, **figures, "spread": {name: _spread(values) for name, values in samples.items()}}


def _spread(values: Sequence[float]) -> dict[str, float]:
    """Return how values are spread, as far as a mean does not say."""
    figures = {f"p{share}": round(_percentile(values, share), 4) for share in (50, 95, 99)}
    return {"objects": len(values), "mean": round(_mean(values), 4), **figures, "max": round(max(values), 4)}


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def _percentile(values: Sequence[float], share: float) -> float:
    return float(np.percentile(values, share))
