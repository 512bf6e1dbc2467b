"""The whole run: render, train, strip, evaluate, write the card."""

import json
import logging
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from services.simulator.world import CLASSES
from services.training.card import model_card
from services.training.checkpoints import Checkpoint, extras_of, write_weights
from services.training.collages import PLAIN_SHARE, make_collages, make_plain
from services.training.dataset import numbers_of, rendered, write_dataset
from services.training.evaluation.predictor import PredictorLoader
from services.training.evaluation.run import evaluate, judge_on
from services.training.files import TrainingError, effort_so_far, first_line, metered
from services.training.fitting import Material, device_name, fit
from services.training.mixing import NONE_MADE, MadePictures, write_mix
from services.training.parallel import Progress
from services.training.photographs import PhotographData, read_data
from services.training.refining.fitting import CHECKPOINT, kept_state
from services.training.refining.refinement import Refinement
from services.training.refining.run import NO_REFINER, refine
from services.training.settings import DECISIVE, TrainingSettings
from services.training.stages import Judge, stages_of
from services.training.trainer import load_ultralytics

MOST_NAMED: Final = 10

log = logging.getLogger(__name__)


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
    photographs = read_data(settings.data)
    classes = photographs.classes
    given = None if settings.start is None else _read_checkpoint(settings.start, "name weights to find boxes or masks")
    _check_classes(settings, classes, given)
    if settings.only_refiner and given is not None:
        _check_refinable(settings, classes, given)
    if settings.patience and not any(each.objects for each in photographs.tests):
        raise TrainingError(
            "--patience: no object in the pictures of val or test, so that none of them is found better"
        )
    _claim(work_dir, settings, classes)
    _check_checkpoints(settings)
    start = None if given is None else _start(settings, classes, given)
    record = work_dir / "effort.json"
    with metered(record):
        if start is not None and settings.only_refiner:
            checkpoint, made = start, NONE_MADE
        else:
            judge = judge_on(photographs, settings, progress, load)
            checkpoint, made = _fitted(settings, photographs, start, progress, judge)
        unrefined = work_dir / "unrefined.pt"
        write_weights(checkpoint, unrefined, settings.imgsz)
        own = classes == CLASSES and (given is None or given.task == "segment")
        refined = refine(settings, unrefined, refinement, progress) if own else NO_REFINER
        write_weights(checkpoint, settings.output, settings.imgsz, refined.kept)
    with metered(record):
        figures = evaluate(settings, progress, load, photographs, unrefined if refined.kept else None)
    card = model_card(settings, figures, effort_so_far(record), refined.objects, made)
    settings.output.with_suffix(".md").write_text(card)


def _fitted(
    settings: TrainingSettings,
    photographs: PhotographData,
    start: Path | None,
    progress: Progress,
    judge: Judge,
) -> tuple[Path, MadePictures]:
    """Render, train the model, and average it as wanted; return its checkpoint, and which pictures were made for it."""
    drawn = bool(numbers_of(photographs.classes, settings.class_names))
    # Where the simulator has none of the classes, its objects may look like them all the same.
    dataset = write_dataset(
        settings.work_dir / "data",
        progress,
        seed=settings.seed,
        images=settings.images if drawn else 0,
        holdout=settings.holdout if drawn else 0,
        workers=settings.workers,
        classes=photographs.classes,
        new_names=settings.class_names,
    )
    mix, made = _mixed(settings, photographs, rendered(dataset)) if settings.data else (None, NONE_MADE)
    trained = fit(settings, Material(dataset, mix, photographs.classes, start), progress, judge)
    return _averaged(settings, trained, start), made


def _check_refinable(settings: TrainingSettings, classes: Sequence[str], given: Checkpoint) -> None:
    """Check that weights can get a refiner, and stay as they are otherwise.

    Raises:
        TrainingError: they cannot.
    """
    if given.task != "segment":
        raise TrainingError(f"--only-refiner: {settings.start} finds boxes, and no masks that could be refined")
    if tuple(given.classes) != CLASSES or tuple(classes) != CLASSES:
        found = ", ".join(given.classes if tuple(given.classes) != CLASSES else classes)
        raise TrainingError(f"--only-refiner: the classes are {found}; it learns from {', '.join(CLASSES)} alone")
    assert settings.start is not None  # noqa: S101 - where the weights were read
    side = extras_of(settings.start).get("train_args", {}).get("imgsz", settings.imgsz)
    if side != settings.imgsz:
        raise TrainingError(f"--imgsz {settings.imgsz}: the weights of --from are for {side}; give --imgsz {side}")


def _check_classes(settings: TrainingSettings, classes: Sequence[str], given: Checkpoint | None) -> None:
    """Check the names of classes.

    Raises:
        TrainingError: a class to be renamed is not there, two would get one name, or there is nothing to learn from.
    """
    known = list(dict.fromkeys((*CLASSES, *(given.classes if given else ()))))
    for old, new in settings.class_names.items():
        if old not in known:
            raise TrainingError(f"--class-names: no class {old!r}; there are {', '.join(known)}")
        if new not in classes:
            raise TrainingError(f"--class-names {old}={new}: no data.yaml names {new!r}; those do {', '.join(classes)}")
    for names in (CLASSES, given.classes if given else ()):
        for new, times in Counter(settings.class_names.get(name, name) for name in names).items():
            if times > 1 and new in settings.class_names.values():
                raise TrainingError(f"--class-names: {times} classes would be {new!r}; give each a name of its own")
    if given is None and not numbers_of(classes, settings.class_names):
        raise TrainingError(f"the simulator has none of {', '.join(classes)}: name weights to begin with by --from")


def _start(settings: TrainingSettings, classes: Sequence[str], given: Checkpoint) -> Path:
    """Return the weights to begin with, changed so that they have these classes.

    Raises:
        TrainingError: they cannot be.
    """
    import torch  # noqa: PLC0415 - only the training needs it

    log.info("%s", _told(given.classes, classes, settings.class_names))
    torch.manual_seed(settings.seed)
    changed = settings.work_dir / "start.pt"
    try:
        given.with_classes(classes, settings.class_names).write(changed, {})
    except Exception as error:
        raise TrainingError(f"{settings.start}: cannot be trained ({first_line(error)})") from error
    return changed


def _told(before: Sequence[str], after: Sequence[str], new_names: Mapping[str, str]) -> str:
    """Say which classes a model gets, and which it had."""
    named = {new_names.get(name, name): name for name in before}
    new = [name for name in after if name not in named]
    left_out = [name for new_name, name in named.items() if new_name not in after]
    if len(left_out) > MOST_NAMED:
        left_out[MOST_NAMED:] = [f"{len(left_out) - MOST_NAMED} more"]
    told = f"classes: {', '.join(after)}"
    told += f"; new: {', '.join(new)}" if new else ""
    return told + (f"; left out, as no data.yaml names them: {', '.join(left_out)}" if left_out else "")


def _mixed(
    settings: TrainingSettings, photographs: PhotographData, rendered_pictures: Sequence[Path]
) -> tuple[Path, MadePictures]:
    """Write the last stage's data set: photographs, what is made of them, and rendered pictures."""
    folder = settings.work_dir / "made"
    collages = make_collages(folder, photographs.training, settings.collages, settings.seed)
    pictures = [*photographs.training, *collages]
    # Few photographs are not to drown in plain pictures, which are shown as often as others without any of the classes.
    count = min(settings.collages // PLAIN_SHARE, -(-len(pictures) // PLAIN_SHARE))
    plain = make_plain(folder, count, settings.seed)
    mix = write_mix(settings.work_dir / "mix", [*pictures, *plain], rendered_pictures, photographs.classes)
    return mix, MadePictures(sum(bool(each.objects) for each in collages), len(plain))


def _averaged(settings: TrainingSettings, checkpoint: Path, start: Path | None) -> Path:
    """Average a checkpoint with the weights that the run began with, as far as these are to be kept."""
    if start is None or not settings.keep:
        return checkpoint
    averaged = settings.work_dir / "averaged.pt"
    Checkpoint.read(checkpoint).averaged(Checkpoint.read(start), settings.keep).write(averaged, {})
    return averaged


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


def _claim(work_dir: Path, settings: TrainingSettings, classes: Sequence[str]) -> None:
    """Record the settings of the run and its classes in its directory, which fits one set of them only."""
    note = work_dir / "settings.json"
    wanted = json.dumps({**settings.model_dump(mode="json", include=DECISIVE), "classes": classes})
    try:
        if note.exists() and note.read_text() != wanted:
            raise TrainingError(f"--work-dir {work_dir}: holds a run with other settings; choose another or remove it")
        note.write_text(wanted)
    except OSError as error:
        raise TrainingError(f"{note}: {error.strerror}") from error


def _check_checkpoints(settings: TrainingSettings) -> None:
    """Check in advance for errors that would otherwise occur after hours."""
    for stage in stages_of(settings):
        if (checkpoint := stage.checkpoint(settings.work_dir)).exists():
            _read_checkpoint(checkpoint, "remove it")
    kept_state(settings.work_dir / CHECKPOINT)


def _read_checkpoint(checkpoint: Path, cure: str) -> Checkpoint:
    try:
        return Checkpoint.read(checkpoint)
    except Exception as error:
        raise TrainingError(f"{checkpoint}: not a checkpoint ({first_line(error)}); {cure}") from error
