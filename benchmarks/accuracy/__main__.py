"""How well the shipped model sees held-out scenes of the simulated warehouse.

Each scene is of a seed that no training run takes, and seen once, at 640x480, from a place as the training's pictures
are taken from, by a camera with faults drawn at random. The model looks at it the way a detector looks at a camera's
picture, but at a confidence of 0.001, for at most 100 objects, and with one thread: more would gain little on a machine
that has nothing else to do, and lose much on one that has.

    mask_map50, mask_map50_95  COCO's average precision of masks, over the objects of which at least half is visible, on
                               at least 0.1 % of the picture; all other objects are ignore regions
    per_class, per_size        the same of each class, and of each of COCO's bands of visible pixels
    classes_exact              the share of pictures whose list of classes is right at a detector's default confidence:
                               it has every class with an object at least half visible on at least 0.3 % of the picture,
                               and none without an object that is visible on more than 0.05 % of it
    wrong_pictures             in how many pictures each class was missed, and in how many it was invented
    by_confidence              the same at other confidences

Scenes are rendered once and kept in the work directory, until what renders them changes.
"""

import argparse
import contextlib
import hashlib
import json
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.accuracy.report import report
from benchmarks.machine import machine, versions
from benchmarks.progress import note
from services.detector.model import ModelError
from services.detector.settings import SHIPPED_MODEL, DetectorSettings
from services.simulator.training.errors import TrainingError
from services.simulator.training.evaluation.held_out import scored
from services.simulator.training.evaluation.looking import LOWEST_CONFIDENCE
from services.simulator.training.evaluation.scenes import generator_digest, held_out_seeds, held_out_views
from services.toolbox.train.inference import open_weights

SEED: Final = 1
REPORT_EVERY: Final = 20
DEFAULT_CONFIDENCE: Final[float] = DetectorSettings.model_fields["confidence"].default
PACKAGES: Final = ("ultralytics-opencv-headless", "torch", "pycocotools", "numpy", "opencv-python-headless")


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print. Bad weights end it with one line and the exit code 2."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.accuracy", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--weights", type=Path, default=SHIPPED_MODEL, help="the model (default: the shipped one)")
    parser.add_argument("--scenes", type=_count, default=300, help="how many (default: 300)")
    parser.add_argument("--device", help="cpu, cuda:0, ...; the best there is unless given")
    parser.add_argument("--workers", type=_count, default=os.cpu_count(), help="processes that render (default: cores)")
    parser.add_argument(
        "--work-dir", type=Path, default=Path("runs/accuracy"), help="keeps scenes (default: %(default)s)"
    )
    arguments = parser.parse_args(argv)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            found = measure(
                arguments.weights, arguments.scenes, arguments.device, arguments.workers, arguments.work_dir
            )
    except (ModelError, TrainingError, OSError) as error:
        parser.exit(2, f"{parser.prog}: {' '.join(str(error).split())}\n")
    print(json.dumps(found) if arguments.json else "\n".join(f"{name}: {value}" for name, value in found.items()))


def measure(weights: Path, scenes: int, device: str | None, workers: int, work_dir: Path) -> dict[str, Any]:
    """Load the model, render, look.

    Raises:
        ModelError: the weights cannot be measured; nothing was rendered.
        TrainingError: a kept scene is damaged.
        OSError: there are no such weights, or the work directory cannot be written.
    """
    digest = hashlib.sha256(weights.read_bytes()).hexdigest()
    seeds = held_out_seeds(SEED, scenes)
    with tempfile.TemporaryDirectory(prefix="fleetsight-", ignore_cleanup_errors=True) as folder:
        look = open_weights(weights, confidence=LOWEST_CONFIDENCE, device=device, folder=Path(folder))
        views = held_out_views(work_dir, seeds, workers, _progress)
        began = time.monotonic()
        score = scored(views, look, lambda done: _progress("look", done, scenes))
        elapsed = time.monotonic() - began
    return {
        **report(score, DEFAULT_CONFIDENCE),
        "seconds": round(elapsed, 1),
        "scenes": scenes,
        "seeds": [seeds[0], seeds[-1]],
        "generator_sha256": generator_digest(),
        "weights": {"file": weights.name, "sha256": digest},
        "machine": machine(),
        "versions": versions(PACKAGES),
    }


def _progress(stage: str, done: int, total: int) -> None:
    if done == total or not done % REPORT_EVERY:
        note(f"{stage} {done}/{total}")


def _count(text: str) -> int:
    count = int(text)
    if count < 1:
        raise argparse.ArgumentTypeError(f"{text} is less than 1")
    return count


if __name__ == "__main__":
    main()
