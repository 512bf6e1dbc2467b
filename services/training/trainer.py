"""Adapts Ultralytics' trainers: fast on CPUs, and quiet."""

import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from services.training.partial_labels import criterion


def trainer_class(*, masks: bool = True, partly_labelled: Sequence[str] = ()) -> type:
    """The trainer of models that find masks, or boxes alone; call it after `load_ultralytics`.

    partly_labelled: the model's classes, where those of the data set are codes of theirs (`partial_labels`).
    """
    import torch  # noqa: PLC0415 - only the training needs it
    from ultralytics.models.yolo.detect import DetectionTrainer  # noqa: PLC0415 - after load_ultralytics
    from ultralytics.models.yolo.segment import SegmentationTrainer  # noqa: PLC0415 - after load_ultralytics

    plain_trainer: Any = SegmentationTrainer if masks else DetectionTrainer

    class Trainer(plain_trainer):  # type: ignore[misc]
        """Never validates: we evaluate the final file ourselves."""

        def final_eval(self) -> None:
            return

        def validate(self) -> tuple[dict[str, float], float]:
            return {}, 0.0

        def preprocess_batch(self, batch: dict[str, Any]) -> dict[str, Any]:
            batch = super().preprocess_batch(batch)
            batch["img"] = batch["img"].contiguous(memory_format=torch.channels_last)
            return batch

        def build_optimizer(self, *args: Any, **options: Any) -> Any:
            untyped: Any = super()
            optimizer = untyped.build_optimizer(*args, **options)
            for group in optimizer.param_groups:  # Ultralytics asks for the fused step on GPUs only
                group.update(fused=True, foreach=False)
            return optimizer

    return _partly_labelled(Trainer, partly_labelled) if partly_labelled else Trainer


def _partly_labelled(trainer: Any, classes: Sequence[str]) -> type:
    """Return a trainer for some classes on a data set with `partial_labels` codes."""

    class PartialLabelsTrainer(trainer):  # type: ignore[misc]
        def get_model(self, *args: Any, **options: Any) -> Any:
            codes, self.data["nc"] = self.data["nc"], len(classes)
            try:
                return super().get_model(*args, **options)
            finally:
                self.data["nc"] = codes

        def set_model_attributes(self) -> None:
            super().set_model_attributes()
            self.model.nc, self.model.names = len(classes), dict(enumerate(classes))

        def _setup_train(self, *args: Any, **options: Any) -> None:
            super()._setup_train(*args, **options)
            self.model.criterion = criterion(self.model)
            if self.start_epoch and hasattr(self.model.criterion, "update"):  # its parts' weights go by the epoch
                self.model.criterion.updates = self.start_epoch - 1
                self.model.criterion.update()

    return PartialLabelsTrainer


@contextmanager
def quick_arithmetic(threads: int, device: str) -> Iterator[None]:
    """Enable torch's shortcuts: denormals count as zero, and bfloat16 where the processor supports it.

    Enter it before torch starts its threads, which take the first over; bfloat16 is about twice as fast as float32.
    """
    import torch  # noqa: PLC0415 - only the training needs it

    bfloat16 = device == "cpu" and torch.cpu._is_avx512_bf16_supported()  # noqa: SLF001 - there is no public name
    torch.set_num_threads(threads)
    torch.set_flush_denormal(True)
    try:
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=bfloat16):
            yield
    finally:
        torch.set_flush_denormal(False)


_QUIET: Final = {
    "YOLO_OFFLINE": "true",
    "YOLO_AUTOINSTALL": "false",
    "YOLO_VERBOSE": "false",
}
_SILENCED: Final = ("sync", "clearml", "comet", "dvc", "mlflow", "raytune", "tensorboard", "wandb", "hub")


def load_ultralytics(config_dir: Path) -> ModuleType:
    """Import ultralytics with its own files in `config_dir` (created) and every integration off."""
    config_dir.mkdir(parents=True, exist_ok=True)
    os.environ.update(_QUIET, YOLO_CONFIG_DIR=str(config_dir.resolve()))
    import ultralytics  # noqa: PLC0415 - it reads the environment when it is imported

    ultralytics.settings.update({key: False for key in _SILENCED if key in ultralytics.settings})
    ultralytics.utils.LOGGER.setLevel(logging.ERROR)
    _hide_bars(import_module("ultralytics.data.base"), import_module("ultralytics.utils.tqdm").TQDM)
    return ultralytics


def _hide_bars(module: Any, bar: Any) -> None:
    """Suppress the progress bars that a module of Ultralytics shows even when told to be quiet."""

    def unseen(*arguments: Any, **options: Any) -> Any:
        return bar(*arguments, **options | {"disable": True})

    module.TQDM = unseen
