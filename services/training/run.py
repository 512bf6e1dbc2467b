"""The whole run: render, train, strip, evaluate, write the card."""

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

from services.training.card import Figures, effort_so_far, metered, model_card
from services.training.checkpoints import Checkpoint, write_weights
from services.training.collages import PLAIN_SHARE, make_collages, make_plain
from services.training.dataset import VIEWS, holdout_seed, rendered, write_dataset
from services.training.evaluation.class_lists import ListScore
from services.training.evaluation.mistakes import Mistakes
from services.training.evaluation.near_objects import near_figures
from services.training.evaluation.photographs import PhotographScore, score_photographs
from services.training.evaluation.precision import MaskScore
from services.training.evaluation.predictor import CONFIDENCE, LOWEST_CONFIDENCE, Predictor, PredictorLoader
from services.training.evaluation.scenes import HeldOutView, held_out_seeds, held_out_views
from services.training.files import TrainingError, first_line
from services.training.fitting import device_name, fit
from services.training.mixing import NONE_MADE, MadePictures, write_mix
from services.training.parallel import Progress
from services.training.photographs import Photograph, PhotographData, read_data
from services.training.refining.fitting import CHECKPOINT, kept_state
from services.training.refining.refinement import Refinement
from services.training.refining.run import refine
from services.training.settings import DECISIVE, TrainingSettings
from services.training.stages import stages_of
from services.training.trainer import load_ultralytics


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


DRIVES: Final = 20
FRAMES_PER_DRIVE: Final = 24


def train(settings: TrainingSettings, progress: Progress, load: PredictorLoader, refinement: Refinement) -> None:
    """Make `settings.output` and the model card beside it, resuming an earlier interrupted run.

    load: loads the weights as a detector would, to evaluate them. refinement: that detector's.

    Raises TrainingError, before anything is rendered, when the output or the work directory cannot be written, when the
    device is not there, when the work directory belongs to a run with other settings or what it holds is no
    checkpoint, and when photographs to train or test on cannot be read.
    """
    work_dir = settings.work_dir
    _check_folder("--output", settings.output, settings.output.parent)
    _check_folder("--work-dir", work_dir, work_dir)
    _check_device(settings)
    _claim(work_dir, settings)
    _check_checkpoints(settings)
    photographs = read_data(settings.data)
    record = work_dir / "effort.json"
    with metered(record):
        dataset = write_dataset(
            work_dir / "data",
            progress,
            seed=settings.seed,
            images=settings.images,
            holdout=settings.holdout,
            workers=settings.workers,
        )
        mix, made = _mixed(settings, photographs, rendered(dataset)) if settings.data else (None, NONE_MADE)
        checkpoint, unrefined = _averaged(settings, fit(settings, dataset, progress, mix)), work_dir / "unrefined.pt"
        write_weights(checkpoint, unrefined, settings.imgsz)
        refined = refine(settings, unrefined, refinement, progress)
        write_weights(checkpoint, settings.output, settings.imgsz, refined.kept)
    with metered(record):
        figures = evaluate(settings, progress, load, photographs, unrefined if refined.kept else None)
    card = model_card(settings, figures, effort_so_far(record), refined.objects, made)
    settings.output.with_suffix(".md").write_text(card)


def _mixed(
    settings: TrainingSettings, photographs: PhotographData, rendered_pictures: Sequence[Path]
) -> tuple[Path, MadePictures]:
    """Write the last stage's data set: photographs, what is made of them, and rendered pictures."""
    folder = settings.work_dir / "made"
    collages = make_collages(folder, photographs.training, settings.collages, settings.seed)
    plain = make_plain(folder, settings.collages // PLAIN_SHARE, settings.seed)
    mix = write_mix(settings.work_dir / "mix", [*photographs.training, *collages, *plain], rendered_pictures)
    return mix, MadePictures(sum(bool(each.objects) for each in collages), len(plain))


def _averaged(settings: TrainingSettings, checkpoint: Path) -> Path:
    """Average a checkpoint with the weights that the run began with, as far as these are to be kept."""
    if settings.start is None or not settings.keep:
        return checkpoint
    averaged = settings.work_dir / "averaged.pt"
    Checkpoint.read(checkpoint).averaged(Checkpoint.read(settings.start), settings.keep).write(averaged, {})
    return averaged


def evaluate(
    settings: TrainingSettings,
    progress: Progress,
    load: PredictorLoader,
    photographs: PhotographData,
    unrefined: Path | None = None,
) -> Figures:
    """Evaluate the weights at `settings.output` on unseen scenes, and on the photographs to test on, if any.

    unrefined: the same without what refines their masks, if there is such a thing.
    """
    load_at = partial(load, device=device_name(settings), folder=settings.work_dir / "ultralytics")
    seeds = held_out_seeds(settings.seed, settings.holdout)

    def score(weights: Path, stage: str) -> HeldOutScore:
        views = held_out_views(settings.work_dir, seeds, settings.workers, progress)
        predict = load_at(weights, confidence=LOWEST_CONFIDENCE)
        return scored(views, predict, lambda done: progress(stage, done, len(seeds)))

    found = score(settings.output, "evaluate")
    before = None if unrefined is None else score(unrefined, "evaluate unrefined").masks.figures().overall
    drives = min(DRIVES, settings.holdout)
    tests = photographs.tests
    predict = load_at(settings.output, confidence=CONFIDENCE)
    pictures = _on_photographs(settings, tests, predict, progress) if tests else {}
    near = near_figures(
        predict,
        [holdout_seed(settings.seed, settings.holdout // VIEWS + 1 + index) for index in range(drives)],
        FRAMES_PER_DRIVE,
        lambda done: progress("drive", done, drives),
    )
    return Figures(found.masks.figures(), found.lists.figures(CONFIDENCE), near, before, pictures, photographs.licences)


def _on_photographs(
    settings: TrainingSettings, tests: Sequence[Photograph], predict: Predictor, progress: Progress
) -> Mapping[str, PhotographScore]:
    """Return the scores on photographs, and write the page of mistakes in them beside the weights."""
    mistakes = Mistakes()
    scores = score_photographs(
        tests, predict, lambda done: progress("photographs", done, len(tests)), look=mistakes.add
    )
    page = mistakes.page(settings.output.stem, scores)
    settings.output.with_suffix(".html").write_text(page, encoding="utf-8")
    return scores


def _check_folder(option: str, named: Path, folder: Path) -> None:
    """Check that files can be written to a folder, creating it; `named` is the option's value."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise TrainingError(f"{option} {named}: {error.strerror}") from error


def _check_device(settings: TrainingSettings) -> None:
    ultralytics = load_ultralytics(settings.work_dir / "ultralytics")
    try:
        ultralytics.utils.torch_utils.select_device(device_name(settings), verbose=False)
    except Exception as error:
        raise TrainingError(f"--device {settings.device}: {first_line(error)}") from error


def _claim(work_dir: Path, settings: TrainingSettings) -> None:
    """Record the settings of the run in its directory, which fits one set of settings only."""
    note = work_dir / "settings.json"
    wanted = settings.model_dump_json(include=DECISIVE)
    try:
        if note.exists() and note.read_text() != wanted:
            raise TrainingError(f"--work-dir {work_dir}: holds a run with other settings; choose another or remove it")
        note.write_text(wanted)
    except OSError as error:
        raise TrainingError(f"{note}: {error.strerror}") from error


def _check_checkpoints(settings: TrainingSettings) -> None:
    """Check in advance for errors that would otherwise occur after hours."""
    if settings.start is not None:
        _check_checkpoint(settings.start)
    for stage in stages_of(settings):
        _check_checkpoint(stage.checkpoint(settings.work_dir))
    kept_state(settings.work_dir / CHECKPOINT)


def _check_checkpoint(checkpoint: Path) -> None:
    try:
        if checkpoint.exists():
            Checkpoint.read(checkpoint)
    except Exception as error:
        raise TrainingError(f"{checkpoint}: not a checkpoint ({first_line(error)}); remove it") from error
