"""Runs the training: Ultralytics' trainer on our data set, from scratch, in stages, resumable."""

import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from services.training.checkpoints import ARCHITECTURE, Checkpoint
from services.training.parallel import Progress
from services.training.settings import TrainingSettings
from services.training.stages import BestEpoch, Judge, TrainingStage, stages_of
from services.training.trainer import load_ultralytics, quick_arithmetic, trainer_class

AUGMENTATION: Final = {
    "mosaic": 0.0,
    "erasing": 0.0,
    "degrees": 0.0,
    "translate": 0.05,
    "scale": 0.25,
    "fliplr": 0.5,
    "hsv_h": 0.01,
    "hsv_s": 0.3,
    "hsv_v": 0.2,
}


MIXED_AUGMENTATION: Final = {
    "mosaic": 0.35,
    "close_mosaic": 0,
    "erasing": 0.0,
    "degrees": 4.0,
    "translate": 0.15,
    "scale": 0.5,
    "shear": 2.0,
    "perspective": 0.0003,
    "fliplr": 0.5,
    "hsv_h": 0.03,
    "hsv_s": 0.6,
    "hsv_v": 0.45,
    "rect": False,
    "overlap_mask": False,
    "cls": 0.7,
}
"""Photographs are few: they are varied more, and shown in mosaics."""


@dataclass(frozen=True, slots=True)
class Material:
    """The material of a run. rendered: the data set of rendered pictures; mix: that of these and photographs.

    classes: names by number. begin: the weights to begin with, if any, which have these classes.
    """

    rendered: Path
    mix: Path | None
    classes: Sequence[str]
    begin: Path | None = None


def fit(settings: TrainingSettings, material: Material, progress: Progress, judge: Judge | None = None) -> Path:
    """Train every stage to its last epoch, resuming from an earlier checkpoint; return the path of the checkpoint.

    judge: says how good a checkpoint of the stage with photographs is; where `settings.patience` is not 0 its best one
    is the result.
    """
    load_ultralytics(settings.work_dir / "ultralytics")
    folders = (material.rendered.parent, settings.work_dir / "mix")
    for cache in (cache for folder in folders for cache in folder.rglob("*.cache")):
        cache.unlink()  # a pickle, which Ultralytics would execute
    last = material.begin
    for stage in stages_of(settings):
        checkpoint = stage.checkpoint(settings.work_dir)
        done = Checkpoint.read(checkpoint).epoch + 1 if checkpoint.exists() else 0
        best = BestEpoch(checkpoint, settings.patience, judge) if stage.mixed and judge and settings.patience else None
        if best and done:
            best.catch_up(done - 1)
        if done < stage.epochs and not (best and best.waited_enough):
            _fit_stage(stage, checkpoint if done else last, settings, material, progress, best=best, resume=done > 0)
        last = best.checkpoint if best else checkpoint
    assert last is not None  # noqa: S101 - there is at least one stage
    return last


def device_name(settings: TrainingSettings) -> str:
    """The device to train on, in Ultralytics' words."""
    import torch  # noqa: PLC0415 - only the training needs it

    if settings.device != "auto":
        return settings.device
    return "0" if torch.cuda.is_available() else "cpu"


def _fit_stage(
    stage: TrainingStage,
    begin: Path | None,
    settings: TrainingSettings,
    material: Material,
    progress: Progress,
    *,
    best: BestEpoch | None,
    resume: bool,
) -> None:
    """Train a stage: with `resume` from its state, else from the weights in the checkpoint `begin`, or from scratch."""
    from ultralytics.models import YOLO  # noqa: PLC0415 - after load_ultralytics

    mix = material.mix if stage.mixed else None
    arguments = _arguments(stage, settings, mix or material.rendered)
    _remove(settings.work_dir / arguments["name"])  # Ultralytics would execute what is there
    source, task = settings.work_dir / "begin.pt", "segment"
    if begin is not None:
        weights = Checkpoint.read(begin)
        task = weights.task
        weights.write(source, {"task": task, "mode": "train", "model": weights.architecture_name, **arguments})
    model = YOLO(str(source if begin is not None else ARCHITECTURE), task=task)
    _watch(model, stage, settings, progress, best)
    trainer = trainer_class(masks=task == "segment", partly_labelled=material.classes if mix else ())
    with quick_arithmetic(settings.workers, device_name(settings)):
        model.train(trainer=trainer, resume=resume, **arguments)
    source.unlink(missing_ok=True)


def _remove(folder: Path) -> None:
    if folder.is_symlink():
        folder.unlink()
    with suppress(FileNotFoundError):
        shutil.rmtree(folder)


def _arguments(stage: TrainingStage, settings: TrainingSettings, dataset: Path) -> dict[str, Any]:
    device = device_name(settings)
    return {
        "data": str(dataset),
        "project": str(settings.work_dir.resolve()),
        "name": f"fit-{stage.name}",
        "epochs": stage.epochs,
        "imgsz": stage.imgsz,
        "batch": settings.batch,
        "nbs": settings.batch,
        "seed": settings.seed,
        "device": device,
        "rect": True,
        "workers": settings.workers,
        "optimizer": "AdamW",
        "lr0": stage.first_rate,
        "lrf": stage.last_rate / stage.first_rate,
        "cos_lr": True,
        "warmup_epochs": 0.3,
        "warmup_bias_lr": 0.0,
        "amp": device != "cpu",
        "freeze": settings.freeze if stage.mixed else 0,
        "val": False,
        "plots": False,
        "exist_ok": True,
        "verbose": False,
        **(MIXED_AUGMENTATION if stage.mixed else AUGMENTATION),
    }


def _watch(
    model: Any, stage: TrainingStage, settings: TrainingSettings, progress: Progress, best: BestEpoch | None
) -> None:
    """Report every batch, keep every epoch, and restore the thread count, which Ultralytics reduces to one."""
    import torch  # noqa: PLC0415 - only the training needs it

    def prepare(trainer: Any) -> None:
        torch.set_num_threads(settings.workers)
        trainer.model.to(memory_format=torch.channels_last)

    done = 0

    def count(trainer: Any) -> None:
        nonlocal done
        done += 1
        batches = len(trainer.train_loader)
        progress(f"train {stage.name}", trainer.start_epoch * batches + done, trainer.epochs * batches)

    def keep(trainer: Any) -> None:
        checkpoint = stage.checkpoint(settings.work_dir)
        partial = checkpoint.with_suffix(".part")
        shutil.copyfile(trainer.last, partial)
        partial.replace(checkpoint)
        if best is not None:
            with torch.autocast("cpu", enabled=False):
                best.add(trainer.epoch)
            torch.set_num_threads(settings.workers)
            trainer.stop |= best.waited_enough

    def fall(trainer: Any) -> None:
        batches = len(trainer.train_loader)
        for group in trainer.optimizer.param_groups:
            group["lr"] = group["initial_lr"] * stage.rate(trainer.start_epoch + done / batches)

    model.add_callback("on_train_start", prepare)
    if stage.hold is not None:
        model.add_callback("on_train_batch_start", fall)
    model.add_callback("on_model_save", keep)
    model.add_callback("on_train_batch_end", count)
