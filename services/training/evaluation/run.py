"""Evaluates a run's weights: on unseen scenes, on drives through such, and on photographs to test on."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from services.simulator.world import CLASSES
from services.training.card import Figures, SimulatorFigures
from services.training.checkpoints import Checkpoint, write_weights
from services.training.dataset import VIEWS, holdout_seed, numbers_of
from services.training.evaluation.class_lists import ListScore
from services.training.evaluation.mistakes import Mistakes
from services.training.evaluation.near_objects import near_figures
from services.training.evaluation.photographs import PhotographScore, score_photographs
from services.training.evaluation.precision import MaskScore
from services.training.evaluation.predictor import CONFIDENCE, LOWEST_CONFIDENCE, Predictor, PredictorLoader
from services.training.evaluation.scenes import HeldOutView, held_out_seeds, held_out_views
from services.training.fitting import device_name
from services.training.parallel import Progress
from services.training.photographs import PhotographData
from services.training.settings import TrainingSettings
from services.training.stages import Judge

DRIVES: Final = 20
FRAMES_PER_DRIVE: Final = 24


@dataclass(frozen=True, slots=True)
class HeldOutScore:
    """The processed images, scored as masks and as class lists."""

    masks: MaskScore = field(default_factory=MaskScore)
    lists: ListScore = field(default_factory=ListScore)


def scored(views: Iterable[HeldOutView], predict: Predictor, report: Callable[[int], None]) -> HeldOutScore:
    """Run `predict`, which returns even the least likely detections, on each image, and report progress."""
    score = HeldOutScore()
    for done, view in enumerate(views, start=1):
        image = view.image()
        found = predict(image)
        score.masks.add((image.shape[0], image.shape[1]), view.truths, found)
        score.lists.add(view.truths, found)
        report(done)
    return score


def evaluate(
    settings: TrainingSettings,
    progress: Progress,
    load: PredictorLoader,
    photographs: PhotographData,
    unrefined: Path | None = None,
) -> Figures:
    """Evaluate the weights at `settings.output`, in the simulator only if they find masks of all that is in it.

    unrefined: the same without what refines their masks, if there is such a thing.
    """
    load_at = partial(load, device=device_name(settings), folder=settings.work_dir / "ultralytics", any_model=True)
    weights = Checkpoint.read(settings.output)
    all_known = len(numbers_of(weights.classes, settings.class_names)) == len(CLASSES)
    found = _in_simulator(settings, progress, load_at, unrefined) if weights.task == "segment" and all_known else None
    pictures = _on_photographs(settings, progress, load_at, photographs) if photographs.tests else {}
    return Figures(weights.classes, weights.architecture_name, weights.task, found, pictures, photographs.licences)


def _in_simulator(
    settings: TrainingSettings, progress: Progress, load: Callable[..., Predictor], unrefined: Path | None
) -> SimulatorFigures:
    seeds = held_out_seeds(settings.seed, settings.holdout)

    def score(weights: Path, stage: str) -> HeldOutScore:
        views = held_out_views(settings.work_dir, seeds, settings.workers, progress)
        predict = _by_the_world_s_names(load(weights, confidence=LOWEST_CONFIDENCE), settings.class_names)
        return scored(views, predict, lambda done: progress(stage, done, len(seeds)))

    found = score(settings.output, "evaluate")
    before = None if unrefined is None else score(unrefined, "evaluate unrefined").masks.figures().overall
    drives = min(DRIVES, settings.holdout)
    near = near_figures(
        _by_the_world_s_names(load(settings.output, confidence=CONFIDENCE), settings.class_names),
        [holdout_seed(settings.seed, settings.holdout // VIEWS + 1 + index) for index in range(drives)],
        FRAMES_PER_DRIVE,
        lambda done: progress("drive", done, drives),
    )
    return SimulatorFigures(found.masks.figures(), found.lists.figures(CONFIDENCE), near, before)


def _by_the_world_s_names(predict: Predictor, new_names: Mapping[str, str]) -> Predictor:
    """Return a predictor of the world's classes alone, by the world's names."""
    names = {new_names.get(name, name): name for name in CLASSES}

    def predict_by_name(image: NDArray[np.uint8]) -> Sequence[Detection]:
        found = (each for each in predict(image) if each.name in names)
        return [msgspec.structs.replace(each, name=names[each.name]) for each in found]

    return predict_by_name


def _on_photographs(
    settings: TrainingSettings, progress: Progress, load: Callable[..., Predictor], photographs: PhotographData
) -> Mapping[str, PhotographScore]:
    """Return the scores on photographs, and write the page of mistakes in them beside the weights."""
    tests, classes = photographs.tests, photographs.classes
    mistakes = Mistakes(classes)
    scores = score_photographs(
        tests,
        load(settings.output, confidence=CONFIDENCE),
        lambda done: progress("photographs", done, len(tests)),
        look=mistakes.add,
        classes=classes,
    )
    page = mistakes.page(settings.output.stem, scores)
    settings.output.with_suffix(".html").write_text(page, encoding="utf-8")
    return scores


def judge_on(
    photographs: PhotographData, settings: TrainingSettings, progress: Progress, load: PredictorLoader
) -> Judge:
    """Return what says how good a checkpoint is: the F1 of its boxes on the photographs to test on."""
    tests, classes = photographs.tests, photographs.classes

    def judge(checkpoint: Path) -> float:
        weights, folder = settings.work_dir / "judged.pt", settings.work_dir / "ultralytics"
        write_weights(checkpoint, weights, settings.imgsz)
        predict = load(weights, confidence=CONFIDENCE, device=device_name(settings), folder=folder, any_model=True)
        scores = score_photographs(tests, predict, lambda done: progress("judge", done, len(tests)), classes=classes)
        return scores["all"].f1

    return judge
