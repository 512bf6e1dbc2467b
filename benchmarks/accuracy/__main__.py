"""How well the shipped model sees held-out scenes of the simulated warehouse.

Each scene is of a seed that no training run takes, and seen once, at 640x480, from a place as the training's pictures
are taken from, by a camera with faults drawn at random. The model looks at it the way a detector looks at a camera's
picture, but at a confidence of 0.001, for at most 100 objects, and with one thread: more would gain little on a machine
that has nothing else to do, and lose much on one that has.

    mask_map50, mask_map50_95  COCO's average precision of masks, over the objects of which at least half is visible, on
                               at least 0.1 % of the picture; all other objects are ignore regions; in the order of
                               the published scores times the published qualities of the masks
    by_score                   the same in the order of scores alone
    per_class, per_size        the same of each class, and of each of COCO's bands of visible pixels
    classes_exact              the share of pictures whose list of classes is right at a detector's default confidence:
                               it has every class with an object at least half visible on at least 0.3 % of the picture,
                               and none without an object that is visible on more than 0.05 % of it
    wrong_pictures             in how many pictures each class was missed, and in how many it was invented
    by_confidence              the same at other confidences
    idf1, idp, idr             how well objects keep their identities on the simulator's drives through further held-out
                               scenes, as it publishes them, five frames a second at a metre a second, and as a detector
                               at its default settings follows them: F1, precision and recall of the best assignment of
                               tracks to the true objects of a drive. A track lies on an object with an IoU of boxes of
                               at least 0.5, as MOTChallenge has it; the objects asked for and ignore regions are those
                               of mask_map50; what has no track yet is not followed
    id_switches                how often an object's track is another one than its last
    following                  what limits them, in objects times frames
    ..._masks                  the same five by the IoU of masks, at least 0.5, as MOTS has it

Scenes and drives are rendered once and kept in the work directory, until what renders them changes.
"""

import contextlib
import hashlib
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, get_args

from benchmarks.accuracy.drives import drive_seeds, held_out_drives
from benchmarks.accuracy.following import followed
from benchmarks.accuracy.report import report
from benchmarks.arguments import at_least_one, parser_of, show
from benchmarks.machine import machine, versions
from benchmarks.progress import note, note_step
from services.detector.model import ModelError
from services.detector.runtime.engine import Runtime
from services.detector.settings import SHIPPED_MODEL, DetectorSettings
from services.toolbox.train.inference import open_follower, open_weights
from services.training.evaluation.predictor import LOWEST_CONFIDENCE
from services.training.evaluation.run import scored
from services.training.evaluation.scenes import generator_digest, held_out_seeds, held_out_views
from services.training.files import TrainingError

REPORT_EVERY: Final = 20
SEED: Final = 1
DEFAULT_CONFIDENCE: Final[float] = DetectorSettings.model_fields["confidence"].default
PACKAGES: Final = ("ultralytics-opencv-headless", "torch", "lapx", "pycocotools", "numpy", "opencv-python-headless")


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print. Bad weights end it with one line and the exit code 2."""
    parser = parser_of("benchmarks.accuracy", __doc__)
    parser.add_argument("--weights", type=Path, default=SHIPPED_MODEL, help="the model (default: the shipped one)")
    parser.add_argument("--scenes", type=at_least_one, default=300, help="how many (default: 300)")
    parser.add_argument("--drives", type=at_least_one, default=8, help="how many (default: 8)")
    parser.add_argument("--drive-frames", type=at_least_one, default=50, help="frames of each (default: 50)")
    parser.add_argument("--device", help="cpu, cuda:0, ...; the best there is unless given")
    parser.add_argument("--runtime", choices=get_args(Runtime), default="torch", help="default: %(default)s")
    parser.add_argument(
        "--workers", type=at_least_one, default=os.cpu_count(), help="processes that render (default: cores)"
    )
    parser.add_argument(
        "--work-dir", type=Path, default=Path("runs/accuracy"), help="keeps scenes (default: %(default)s)"
    )
    arguments = parser.parse_args(argv)
    plan = Plan(**{name: value for name, value in vars(arguments).items() if name != "json"})
    try:
        with contextlib.redirect_stdout(sys.stderr):
            found = measure(plan)
    except (ModelError, TrainingError, OSError) as error:
        parser.exit(2, f"{parser.prog}: {' '.join(str(error).split())}\n")
    show(found, as_json=arguments.json)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What to measure: weights, on so many scenes and drives of so many frames. workers: processes that render."""

    weights: Path
    scenes: int
    drives: int
    drive_frames: int
    device: str | None
    runtime: str
    workers: int
    work_dir: Path


def measure(plan: Plan) -> dict[str, Any]:
    """Load the model, render, look.

    Raises:
        ModelError: the weights cannot be measured; nothing was rendered.
        TrainingError: a kept scene is damaged.
        OSError: there are no such weights, or the work directory cannot be written.
    """
    digest = hashlib.sha256(plan.weights.read_bytes()).hexdigest()
    seeds, ways = held_out_seeds(SEED, plan.scenes), drive_seeds(SEED, plan.drives)
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="fleetsight-", ignore_cleanup_errors=True) as folder:
        device, runtime, cache = plan.device, plan.runtime, Path(folder)
        predict = open_weights(plan.weights, confidence=LOWEST_CONFIDENCE, device=device, folder=cache, runtime=runtime)
        progress = partial(note_step, every=REPORT_EVERY)
        views = held_out_views(plan.work_dir, seeds, plan.workers, progress)
        score = scored(views, predict, lambda done: progress("look", done, plan.scenes))
        follow = open_follower(plan.weights, device=device, folder=cache, runtime=runtime)
        drives = held_out_drives(plan.work_dir, ways, plan.drive_frames, plan.workers, progress)
        ids = followed(drives, follow, lambda done: note(f"follow {done}/{plan.drives}"))
    return {
        **report(score, ids, DEFAULT_CONFIDENCE),
        "seconds": round(time.monotonic() - began, 1),
        "runtime": plan.runtime,
        "scenes": plan.scenes,
        "seeds": [seeds[0], seeds[-1]],
        "drives": plan.drives,
        "drive_seeds": [ways[0], ways[-1]],
        "generator_sha256": generator_digest(),
        "weights": {"file": plan.weights.name, "sha256": digest},
        "machine": machine(),
        "versions": versions(PACKAGES),
    }


if __name__ == "__main__":
    main()
