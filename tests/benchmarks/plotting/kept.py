"""Records as the benchmarks leave them, with figures of the test's own."""

from typing import Any

TARGETS = {"failover_s": 0.5, "hang_failover_s": 3, "woken_double_s": 0.5, "join_gap_s": 0.3, "rolling_gap_s": 1}
ERRORS = {"distance_gt_masks": 0.002, "distance": 0.006, "guide_distance": 0.2, "guide_distance_metres": 0.05}
FIGURES: dict[str, dict[str, Any]] = {
    "gateway": {
        "frames_per_s": 1500.4,
        "rospy_naive_frames_per_s": 480,
        "zenoh_only_frames_per_s": 1700,
        "tcpros_only_frames_per_s": 2000,
        "cpu_ms_per_frame": 0.42,
        "rospy_naive_cpu_ms_per_frame": 1.9,
        "cpu_ms_per_frame_30hz": 1.1,
        "rospy_naive_cpu_ms_per_frame_30hz": 2.9,
        "spread": {"frames_per_s": [1400, 1600]},
    },
    "scaling": {
        "one_worker_results_per_s": 17.6,
        "results_per_s": {"min": 130, "median": 140, "max": 142},
        "failover_s": 0.31,
        "hang_failover_s": 2.4,
        "woken_double_s": 0.1,
        "join_gap_s": 0,
        "rolling_gap_s": 0.4,
    },
    "space": {"spread": {name: {"p50": error, "p99": 6 * error} for name, error in ERRORS.items()}},
    "detector": {
        "auto_fps": 40,
        "worker_fps": 30,
        "bare_fps": 31,
        "torch_fps": 20,
        "bare_torch_fps": 20.5,
        "overhead_p50_ms": 3.21,
    },
    "guide": {
        "fleetsight_sets_per_s_best": 12,
        "fleetsight_sets_per_s_torch": 8.25,
        "guide_sets_per_s_torch": 1.7,
        "fleetsight_age_p50_ms_1hz": 150,
        "guide_age_p50_ms_1hz": 901,
        "hops": [
            {"hop": "model", "ms": {"min": 50, "median": 52.25, "max": 55}, "limit": "a bare call", "limit_ms": 48.5},
            {"hop": "tracking", "ms": 1.5, "limit": None, "limit_ms": None},
            {"hop": "monitor", "ms": None, "limit": None, "limit_ms": None},
        ],
    },
}


def kept(name: str) -> dict[str, Any]:
    return {
        "benchmark": name,
        "date": "2026-01-02T03:04:05+00:00",
        "machine": {"cpu": "A Processor", "cores": 2},
        "targets": {target: {"value": 0, "at_most": limit, "met": True} for target, limit in TARGETS.items()},
        "figures": FIGURES[name],
    }
