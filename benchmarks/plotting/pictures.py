"""The pictures that README and docs show. Each is of one benchmark's record."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from matplotlib.figure import Figure

from benchmarks.plotting.figures import Bar, Figures
from benchmarks.plotting.style import OTHERS, OURS, bars, picture, ranges

GATEWAYS: Final = {
    "": ("fleetsight", OURS),
    "rospy_naive_": ("rospy and zenoh-python", OTHERS),
    "zenoh_only_": ("Zenoh alone, no ROS", OTHERS),
    "tcpros_only_": ("ROS alone, no Zenoh", OTHERS),
}
RECOVERIES: Final = {
    "failover_s": "killed, until others have its cameras",
    "hang_failover_s": "hung, until others have its cameras",
    "woken_double_s": "awake again, until it lets go of them",
    "join_gap_s": "one more, longest extra wait",
    "rolling_gap_s": "all restarted, longest extra wait",
}
DISTANCES: Final = {
    "distance_gt_masks": ("fleetsight, true masks", OURS),
    "distance": ("fleetsight", OURS),
    "guide_distance": ("the guide's, 16UC1 depth", OTHERS),
    "guide_distance_metres": ("the guide's, 32FC1 depth", OTHERS),
}
SPEEDS: Final = {
    "auto_fps": ("worker, quickest runtime", OURS),
    "worker_fps": ("worker, without INT8", OURS),
    "bare_fps": ("bare model, the same", OTHERS),
    "torch_fps": ("worker, torch", OURS),
    "bare_torch_fps": ("bare model, torch", OTHERS),
}
SETS: Final = {
    "fleetsight_sets_per_s_best": ("fleetsight, quickest runtime", OURS),
    "fleetsight_sets_per_s_torch": ("fleetsight, torch", OURS),
    "guide_sets_per_s_torch": ("the guide's pipeline, torch", OTHERS),
}
AGES: Final = {
    "fleetsight_age_p50_ms_1hz": ("fleetsight, quickest runtime", OURS),
    "guide_age_p50_ms_1hz": ("the guide's pipeline, torch", OTHERS),
}


def gateway(found: Figures) -> Figure:
    """Frames per second and processor time of the gateway beside others, with shared memory."""
    with picture("One camera, 640x480, to one subscriber", found.source(), 4, 2) as (figure, (speed, cost)):
        bars(
            speed,
            "frames a second, flat out",
            [(name, found.bar(f"{prefix}frames_per_s"), color) for prefix, (name, color) in GATEWAYS.items()],
            "{:.0f}",
        )
        compared = dict(list(GATEWAYS.items())[:2])
        rows = [
            (f"{name}, {pace}", found.bar(f"{prefix}cpu_ms_per_frame{ending}"), color)
            for ending, pace in (("", "flat out"), ("_30hz", "30 Hz"))
            for prefix, (name, color) in compared.items()
        ]
        bars(cost, "processor time per frame, ms", rows, "{:.2f}")
    return figure


def scaling(found: Figures) -> Figure:
    """What eight workers do beside eight times what one does, and what it takes when workers come and go."""
    one, eight = found.bar("one_worker_results_per_s"), found.bar("results_per_s")
    with picture("Detector workers that share 64 cameras", found.source(), 5, 2) as (figure, (speed, gaps)):
        ideal = Bar(*(8 * value for value in (one.value, one.least, one.greatest)))
        rows = [("1 worker", one, OURS), ("8 workers", eight, OURS), ("8 times one", ideal, OTHERS)]
        bars(speed, "results a second", rows, "{:.0f}")
        rows = [(name, found.bar(figure), OURS) for figure, name in RECOVERIES.items()]
        bars(gaps, "seconds", rows, "{:.2f}", [found.limit(figure) for figure in RECOVERIES])
    return figure


def space(found: Figures) -> Figure:
    """How wrong distances are, beside the guide's formula for the same images."""
    with picture("Error of distances to objects", found.source(), len(DISTANCES)) as (figure, (error,)):
        rows = []
        for name, (label, color) in DISTANCES.items():
            half, most = (found.value("spread", name, share) for share in ("p50", "p99"))
            rows.append((label, Bar(half, half, most), color))
        ranges(error, "share of the true distance: half of all objects to 99 of 100", rows, "{:.2%}")
    return figure


def detector(found: Figures) -> Figure:
    """How many frames a second a worker looks at, beside its bare model."""
    with picture("A detector worker beside its bare model", found.source(), 4) as (figure, (speed,)):
        rows = [(name, found.bar(figure), color) for figure, (name, color) in SPEEDS.items()]
        bars(speed, f"frames a second, 640x480; a frame waits {_overhead(found)}", rows, "{:.1f}")
    return figure


def _overhead(found: Figures) -> str:
    return f"{found.value('overhead_p50_ms'):.1f} ms beside the model's call (median)"


def guide(found: Figures) -> Figure:
    """Whole sets of outputs a second, and how old they are, beside the guide's pipeline."""
    with picture("The complete job beside the guide's pipeline", found.source(), 3, 2) as (figure, (speed, age)):
        bars(speed, "sets of outputs a second", [(n, found.bar(f), c) for f, (n, c) in SETS.items()], "{:.2f}")
        bars(age, "median age at 1 Hz, ms", [(n, found.bar(f), c) for f, (n, c) in AGES.items()], "{:.0f}")
    return figure


def hops(found: Figures) -> Figure:
    """Where the milliseconds of one image's way go, hop by hop, beside what each cannot be quicker than."""
    known = [row for row in found.table("hops") if row.has("ms")]
    with picture("One image's way through fleetsight, at 1 Hz", found.source(), len(known)) as (figure, (way,)):
        rows = [(row.text("hop"), row.bar("ms"), OURS) for row in known]
        bars(
            way, "median, ms", rows, "{:.2f}", [row.value("limit_ms") if row.has("limit_ms") else None for row in known]
        )
    return figure


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture and the benchmark that it is of."""

    benchmark: str
    draw: Callable[[Figures], Figure]


PICTURES: Final[Mapping[str, Picture]] = {
    "gateway": Picture("gateway", gateway),
    "scaling": Picture("scaling", scaling),
    "space": Picture("space", space),
    "detector": Picture("detector", detector),
    "guide": Picture("guide", guide),
    "hops": Picture("guide", hops),
}
"""By the name of the file."""
