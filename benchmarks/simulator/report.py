"""Medians of the simulator's times, their spread, and whether they are what was aimed at. Pure."""

import statistics
from collections.abc import Mapping, Sequence
from typing import Any, Final

from benchmarks.targets import at_least

FRAME: Final = ("render", "smear", "expose", "depth")
LEAST_FRAMES_PER_S: Final = 10


def report(times: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    """Return the figures of views of which the milliseconds of each part are known.

    A frame is its `render`, `smear`, `expose` and `depth`; frames per second are those of all frames together.
    """
    frames = [sum(view[part] for part in FRAME) for view in times]
    parts = {f"{part}_ms": [view[part] for view in times] for part in times[0] if part != "wall"}
    parts["frame_ms"] = frames
    rate = round(1e3 * len(frames) / sum(frames), 1)
    return {
        "targets": at_least({"frames_per_s_one_core": rate}, "frames_per_s_one_core", LEAST_FRAMES_PER_S),
        "frames_per_s_one_core": rate,
        "frames_per_s_wall": round(1e3 * len(frames) / sum(view["wall"] for view in times), 1),
        **{name: round(statistics.median(values), 2) for name, values in parts.items()},
        "spread": {name: [round(min(values), 2), round(max(values), 2)] for name, values in parts.items()},
    }
