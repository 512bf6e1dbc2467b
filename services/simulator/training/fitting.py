"""The training run itself: Ultralytics' trainer on our data set, from scratch, resumable."""

import shutil
from pathlib import Path
from typing import Any, Final

from services.simulator.training.engine import load_ultralytics
from services.simulator.training.progress import Progress
from services.simulator.training.settings import TrainingSettings

ARCHITECTURE: Final = "yolo11n-seg.yaml"
RUN_NAME: Final = "fit"
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


def last_checkpoint(work_dir: Path) -> Path:
    """Where the state after the last whole epoch is kept; always a whole file, unlike Ultralytics' own."""
    return work_dir / "checkpoint.pt"


def fit(settings: TrainingSettings, dataset: Path, progress: Progress) -> Path:
    """Train to the last epoch, going on from an earlier checkpoint, and return the last checkpoint's path."""
    ultralytics = load_ultralytics(settings.work_dir / "ultralytics")
    checkpoint = last_checkpoint(settings.work_dir)
    if checkpoint.exists() and epochs_done(checkpoint) >= settings.epochs:
        return checkpoint
    resumed = checkpoint.exists()
    model = ultralytics.YOLO(str(checkpoint) if resumed else ARCHITECTURE, task="segment")
    _watch(model, settings, progress)
    model.train(
        trainer=_trainer(),
        resume=resumed,
        data=str(dataset),
        project=str(settings.work_dir.resolve()),
        name=RUN_NAME,
        **_arguments(settings),
    )
    return checkpoint


def epochs_done(checkpoint: Path) -> int:
    """How many epochs the state in `checkpoint`, which this command wrote, has seen."""
    import torch  # noqa: PLC0415 - only the training needs it

    state: dict[str, Any] = torch.load(checkpoint, map_location="cpu", weights_only=False)
    return int(state["epoch"]) + 1


def device_name(settings: TrainingSettings) -> str:
    """The device to train on, in Ultralytics' words."""
    import torch  # noqa: PLC0415 - only the training needs it

    if settings.device != "auto":
        return settings.device
    return "0" if torch.cuda.is_available() else "cpu"


def _arguments(settings: TrainingSettings) -> dict[str, Any]:
    return {
        "epochs": settings.epochs,
        "imgsz": settings.imgsz,
        "batch": settings.batch,
        "nbs": settings.batch,
        "seed": settings.seed,
        "device": device_name(settings),
        "rect": True,
        "cache": "ram",
        "workers": 0,
        "optimizer": "AdamW",
        "lr0": 2e-3,
        "lrf": 0.02,
        "cos_lr": True,
        "warmup_epochs": 0.5,
        "pretrained": False,
        "amp": False,
        "val": False,
        "plots": False,
        "exist_ok": True,
        "verbose": False,
        **AUGMENTATION,
    }


def _trainer() -> type:
    from ultralytics.models.yolo.segment import SegmentationTrainer  # noqa: PLC0415 - after load_ultralytics

    class Trainer(SegmentationTrainer):
        """Leaves the last checkpoint as it is: the evaluation is ours, and of the file that is shipped."""

        def final_eval(self) -> None:
            return

        def validate(self) -> tuple[dict[str, float], float]:
            return {}, 0.0

    return Trainer


def _watch(model: Any, settings: TrainingSettings, progress: Progress) -> None:
    """Report every batch, keep every epoch, and give torch the threads asked for (Ultralytics takes all but one)."""
    import torch  # noqa: PLC0415 - only the training needs it

    def set_threads(_trainer: Any) -> None:
        torch.set_num_threads(settings.workers)

    done = 0

    def count(trainer: Any) -> None:
        nonlocal done
        done += 1
        batches = len(trainer.train_loader)
        progress("train", trainer.start_epoch * batches + done, trainer.epochs * batches)

    def keep(trainer: Any) -> None:
        checkpoint = last_checkpoint(settings.work_dir)
        partial = checkpoint.with_suffix(".part")
        shutil.copyfile(trainer.last, partial)
        partial.replace(checkpoint)

    model.add_callback("on_train_start", set_threads)
    model.add_callback("on_model_save", keep)
    model.add_callback("on_train_batch_end", count)
