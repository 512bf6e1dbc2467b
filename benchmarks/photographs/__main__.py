"""How well the shipped model sees labelled photographs.

The photographs are no part of the project: `--folder` names a folder in the form that `fleetsight train --data` takes
(docs/own-classes.md). The pictures in `val` and `test` are looked at the way a detector looks at a camera's, at its
default confidence and with one thread. Without a folder, six rendered pictures stand in for photographs, which shows
that the benchmark runs and says nothing about photographs: `photographs` is false then.

    recall          the share of labelled objects of a class whose box has an IoU of at least 0.5 with a prediction's
    precision       the share of predictions of a class that are right, over sources that label the class
    false_alarms_per_empty_picture
                    predictions per picture in which none of the classes is
    per_source      the same of each source: what a file's name begins with, up to the first `_`
"""

import contextlib
import hashlib
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from benchmarks.arguments import parser_of, show
from benchmarks.machine import machine, versions
from benchmarks.photographs.stand_ins import write_stand_ins
from benchmarks.progress import note_step
from benchmarks.targets import at_least, at_most
from services.detector.model import ModelError
from services.detector.settings import SHIPPED_MODEL, DetectorSettings
from services.simulator.world import CLASSES
from services.toolbox.train.inference import open_weights
from services.training.evaluation.photographs import score_photographs
from services.training.files import TrainingError
from services.training.photographs import TEST_SPLITS, classes_of, read_photographs

REPORT_EVERY: Final = 50
CONFIDENCE: Final[float] = DetectorSettings.model_fields["confidence"].default
PACKAGES: Final = ("ultralytics-opencv-headless", "torch", "numpy", "opencv-python-headless")

LEAST_RECALL: Final = {"box": 0.60, "pallet": 0.75, "forklift": 0.75}
LEAST_PRECISION: Final = 0.75
MOST_FALSE_ALARMS: Final = 0.15


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print. A folder or weights that cannot be used end it with one line and the exit code 2."""
    parser = parser_of("benchmarks.photographs", __doc__)
    parser.add_argument("--folder", type=Path, help="of labelled photographs (default: rendered stand-ins)")
    parser.add_argument("--weights", type=Path, default=SHIPPED_MODEL, help="the model (default: the shipped one)")
    parser.add_argument("--confidence", type=float, default=CONFIDENCE, help="default: %(default)s, a detector's own")
    parser.add_argument("--device", default="cpu", help="cpu, cuda:0, ... (default: %(default)s)")
    arguments = parser.parse_args(argv)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            found = measure(arguments.folder, arguments.weights, arguments.confidence, arguments.device)
    except (ModelError, TrainingError, OSError) as error:
        parser.exit(2, f"{parser.prog}: {' '.join(str(error).split())}\n")
    show(found, as_json=arguments.json)


def measure(folder: Path | None, weights: Path, confidence: float, device: str) -> dict[str, Any]:
    """Load the model and look at every photograph.

    Raises:
        ModelError: the weights cannot be measured.
        TrainingError: the folder has no photographs to measure on, or one of them cannot be read.
        OSError: there are no such weights.
    """
    digest = hashlib.sha256(weights.read_bytes()).hexdigest()
    with tempfile.TemporaryDirectory(prefix="fleetsight-", ignore_cleanup_errors=True) as scratch:
        pictures = folder or write_stand_ins(Path(scratch))
        classes = classes_of([pictures])
        photographs = read_photographs(pictures, *TEST_SPLITS, classes=classes)
        predict = open_weights(weights, confidence=confidence, device=device, folder=Path(scratch), any_model=True)
        progress = partial(note_step, "look", total=len(photographs), every=REPORT_EVERY)
        scores = score_photographs(photographs, predict, lambda done: progress(done=done), classes=classes)
    summaries = {source: score.summary() for source, score in scores.items()}
    overall = summaries.pop("all")
    return {
        **overall,
        "photographs": folder is not None,
        "targets": {} if folder is None else targets(overall),
        "per_source": summaries,
        "confidence": confidence,
        "weights": {"file": weights.name, "sha256": digest},
        "machine": machine(),
        "versions": versions(PACKAGES),
    }


def targets(found: dict[str, Any]) -> dict[str, Any]:
    """Return the aims beside the figures, of the classes that are labelled."""
    flat = {f"{kind}_{name}": found[kind].get(name) for kind in ("recall", "precision") for name in CLASSES}
    flat["false_alarms_per_empty_picture"] = found["false_alarms_per_empty_picture"]
    made: dict[str, Any] = {}
    for name in found["labelled"]:
        made |= at_least(flat, f"recall_{name}", LEAST_RECALL[name])
        made |= at_least(flat, f"precision_{name}", LEAST_PRECISION)
    if found["empty_pictures"]:
        made |= at_most(flat, "false_alarms_per_empty_picture", MOST_FALSE_ALARMS)
    return made


if __name__ == "__main__":
    main()
