"""Ultralytics, held back from everything but computing: no network, no analytics, no fonts, no installs."""

import logging
import os
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, Final

_QUIET: Final = {
    "YOLO_OFFLINE": "true",
    "YOLO_AUTOINSTALL": "false",
    "YOLO_VERBOSE": "false",
}
_SILENCED: Final = ("sync", "clearml", "comet", "dvc", "mlflow", "raytune", "tensorboard", "wandb", "hub")


def load_ultralytics(config_dir: Path) -> ModuleType:
    """Import ultralytics with its own files in `config_dir` (which is made) and every integration off."""
    config_dir.mkdir(parents=True, exist_ok=True)
    os.environ.update(_QUIET, YOLO_CONFIG_DIR=str(config_dir.resolve()))
    import ultralytics  # noqa: PLC0415 - it reads the environment when it is imported

    ultralytics.settings.update({key: False for key in _SILENCED if key in ultralytics.settings})
    ultralytics.utils.LOGGER.setLevel(logging.ERROR)
    _hide_bars(import_module("ultralytics.data.base"), import_module("ultralytics.utils.tqdm").TQDM)
    return ultralytics


def _hide_bars(module: Any, bar: Any) -> None:
    """Keep from showing the bars that a module of Ultralytics shows however quiet it is told to be."""

    def unseen(*arguments: Any, **options: Any) -> Any:
        return bar(*arguments, **options | {"disable": True})

    module.TQDM = unseen
