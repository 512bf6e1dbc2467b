"""The whole run: render, train, strip, evaluate, write the card."""

from pathlib import Path
from typing import Final

from services.simulator.training.card import model_card
from services.simulator.training.dataset import VIEWS, holdout_seed, write_dataset
from services.simulator.training.errors import TrainingError
from services.simulator.training.evaluation import mask_figures, near_figures
from services.simulator.training.fitting import device_name, fit
from services.simulator.training.metering import effort_so_far, metered
from services.simulator.training.progress import Progress
from services.simulator.training.settings import TrainingSettings
from services.simulator.training.weights import write_weights

DRIVES: Final = 20
FRAMES_PER_DRIVE: Final = 24


def train(settings: TrainingSettings, progress: Progress) -> None:
    """Make `settings.output` and the model card beside it, going on where an earlier run was interrupted.

    Raises TrainingError when the work directory belongs to a run with other settings.
    """
    work_dir = settings.work_dir
    _claim(work_dir, settings)
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
        write_weights(fit(settings, dataset, progress), settings.output, settings.imgsz)
    with metered(record):
        progress("evaluate", 0, 1 + DRIVES)
        masks = mask_figures(settings.output, dataset, work_dir, settings.batch, device_name(settings))
        drives = min(DRIVES, settings.holdout)
        seeds = [holdout_seed(settings.seed, settings.holdout // VIEWS + 1 + index) for index in range(drives)]
        near = near_figures(
            settings.output, work_dir, seeds, FRAMES_PER_DRIVE, lambda done: progress("evaluate", 1 + done, 1 + drives)
        )
    card = model_card(settings, masks, near, effort_so_far(record))
    settings.output.with_suffix(".md").write_text(card)


def _claim(work_dir: Path, settings: TrainingSettings) -> None:
    """Note whose directory this is: what is in it fits one set of settings only."""
    work_dir.mkdir(parents=True, exist_ok=True)
    note = work_dir / "settings.json"
    wanted = settings.model_dump_json(
        include={"seed", "images", "holdout", "coarse_epochs", "epochs", "imgsz", "batch"}
    )
    if note.exists() and note.read_text() != wanted:
        raise TrainingError(f"{work_dir} holds a run with other settings: choose another work_dir or remove it")
    note.write_text(wanted)
