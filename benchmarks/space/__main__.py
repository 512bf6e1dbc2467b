"""How exactly distances and object clouds are measured in the simulated warehouse, and how fast.

Each view is of a scene whose seed no training run takes, drawn as the training's views are; a drive is two stretches
of 2.5 m through another such scene. What is measured goes the way that it goes in the services' workers, with their
default settings, without the bus. Masks are the model's, found as a detector finds them, each compared with the object
of its class that it has an IoU of at least 0.5 with, unless something else is said. All figures are over objects of
which at least 200 pixels are visible, within 8 m. A distance that is said to be unknown is no wrong one: how often that
is so is `unknown_distance` in `spread`.

    distance_mae_rel          mean of |measured - true| / true along the optical axis; distance_p99_rel: the 99th
                              percentile; ..._gt_masks: with true masks; ..._unregistered: with depth of another camera
                              of 848x480 pixels, 1.5 cm beside colour
    guide_distance_mae_rel    the guide's formula for the same depth and masks, its millimetres taken for what they are;
                              ..._metres: for the same depth as 32FC1, where what is missing is NaN
    centroid_excess_m         how far a cloud's centroid is from that of the visible surface, less 5 cm and 1 % of its
                              distance: the 95th percentile over objects, which is what the target is for; ..._worst:
                              of the worst object, which may be above 0 where the target is met
    centroids_over            share of the objects whose centroid is farther off than that: whose excess is above 0
    box_extent_rel            mean error of a box's extents along the faces that are seen well: with at least 15 % of
                              the object's visible pixels, at no more than 60 degrees from their normals
    foreign_points            mean share of a cloud's points that are of pixels of something else, or whose depth is off
                              by more than the sensor's error explains: 4 standard deviations and 5 cm
    map_spread_m              mean over objects of the median way from their places in the map to the middle of these,
                              seen from 10 places along 2.5 m of a drive
    ..._ms_p50                640x480, 20 objects, the guide's steps in turn with ours; ..._cpu_ms_p50: processor time

Centroids, boxes and foreign points are with true masks: what the services make of masks. `spread` has the same with
the model's, how often clouds are missing and objects missed, how far the middle of what is visible moves in the map
in truth, and the percentiles of everything.

A machine that is too slow or too busy for all views and drives within --seconds looks at fewer: `size` is what was
done, `asked` what it was asked for.
"""

import argparse
import contextlib
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, get_args

import cv2

from benchmarks.arguments import at_least_one, parser_of, show
from benchmarks.machine import machine, versions
from benchmarks.progress import note, note_step
from benchmarks.space.drives import FRAMES, spreads
from benchmarks.space.errors import Samples, add_view
from benchmarks.space.report import report
from benchmarks.space.speed import crowded_views
from benchmarks.space.speed import measure as measure_speed
from benchmarks.space.views import seeds, view_of
from services.detector.model import ModelError
from services.detector.runtime.engine import Runtime
from services.detector.settings import SHIPPED_MODEL
from services.toolbox.train.inference import open_weights
from services.training.evaluation.predictor import CONFIDENCE

DRIVES_FIRST: Final = 220_000
"""The number, among a run's held-out scenes, of the first that is driven through."""

VIEWS: Final = 200
DRIVES: Final = 8
ROUNDS: Final = 30
CROWDED: Final = 5
REPORT_EVERY: Final = 10
SECONDS: Final = 360.0
FOR_VIEWS: Final = 0.7
"""The share of it that views may take."""
PACKAGES: Final = ("numpy", "opencv-python-headless", "msgspec", "ultralytics-opencv-headless", "torch")


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print. Bad weights end it with one line and the exit code 2."""
    parser = parser_of("benchmarks.space", __doc__)
    parser.add_argument("--weights", type=Path, default=SHIPPED_MODEL, help="the model (default: the shipped one)")
    parser.add_argument("--runtime", choices=get_args(Runtime), default="torch", help="default: %(default)s")
    parser.add_argument("--views", type=at_least_one, default=VIEWS, help="how many scenes (default: %(default)s)")
    parser.add_argument(
        "--drives", type=at_least_one, default=DRIVES, help="how many more to drive in (default: %(default)s)"
    )
    parser.add_argument("--frames", type=at_least_one, default=FRAMES, help="of each stretch (default: %(default)s)")
    parser.add_argument(
        "--crowded", type=at_least_one, default=CROWDED, help="views that are timed (default: %(default)s)"
    )
    parser.add_argument(
        "--rounds", type=at_least_one, default=ROUNDS, help="times that each is timed (default: %(default)s)"
    )
    parser.add_argument(
        "--seconds", type=float, default=SECONDS, help="that views and drives may take (default: %(default)g)"
    )
    arguments = parser.parse_args(argv)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            found = measure(arguments.weights, arguments.runtime, _size(arguments), arguments.seconds)
    except (ModelError, OSError) as error:
        parser.exit(2, f"{parser.prog}: {' '.join(str(error).split())}\n")
    show(found, as_json=arguments.json)


@dataclass(frozen=True, slots=True)
class Size:
    """How much is measured: views, drives and the frames of a stretch of them, views that are timed, and how often."""

    views: int
    drives: int
    frames: int
    crowded: int
    rounds: int


def _size(arguments: argparse.Namespace) -> Size:
    return Size(arguments.views, arguments.drives, arguments.frames, arguments.crowded, arguments.rounds)


def measure(weights: Path, runtime: str, asked: Size, seconds: float) -> dict[str, Any]:
    """Load the model, look, measure. seconds: after which no view or drive begins but the first.

    Raises:
        ModelError: the weights cannot be measured.
        OSError: there are no such weights.
    """
    began = time.monotonic()
    view_seeds, drive_seeds = seeds(asked.views), seeds(asked.drives, DRIVES_FIRST)
    views = drives = 0
    with tempfile.TemporaryDirectory(prefix="fleetsight-", ignore_cleanup_errors=True) as folder:
        predict = open_weights(weights, confidence=CONFIDENCE, device="cpu", folder=Path(folder), runtime=runtime)
        samples = Samples(list)
        for views, seed in _while_time(view_seeds, began + FOR_VIEWS * seconds):
            view = view_of(seed)
            add_view(view, predict(view.image), samples)
            note_step("views", views, asked.views, REPORT_EVERY)
        for drives, seed in _while_time(drive_seeds, began + seconds):
            for measured, true in spreads(seed, predict, asked.frames):
                samples["map_spread"].append(measured)
                samples["map_spread_true"].append(true)
            note_step("drives", drives, asked.drives, REPORT_EVERY)
    note("times")
    wall_ms, cpu_ms = measure_speed(crowded_views(asked.crowded), asked.rounds)
    return {
        **report(samples, wall_ms, cpu_ms),
        "seconds": round(time.monotonic() - began, 1),
        "size": asdict(replace(asked, views=views, drives=drives)),
        "asked": asdict(asked),
        "seeds": {"views": [view_seeds[0], view_seeds[views - 1]], "drives": [drive_seeds[0], drive_seeds[drives - 1]]},
        "weights": weights.name,
        "runtime": runtime,
        "threads": {"opencv": cv2.getNumThreads(), "model": 1},
        "machine": machine(),
        "versions": versions(PACKAGES),
    }


def _while_time(seeds: Sequence[int], until: float) -> Iterator[tuple[int, int]]:
    """Return how many there were so far, and the next one, until it is too late for more than the first."""
    for done, seed in enumerate(seeds, start=1):
        if done > 1 and time.monotonic() > until:
            note(f"no time for more than {done - 1} of {len(seeds)}")
            return
        yield done, seed


if __name__ == "__main__":
    main()
