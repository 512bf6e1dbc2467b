"""Ultralytics, held back from everything but computing: no network, no analytics, no fonts, no installs."""

import logging
import os
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
    from ultralytics.data import base  # noqa: PLC0415 - as above

    ultralytics.settings.update({key: False for key in _SILENCED if key in ultralytics.settings})
    ultralytics.utils.LOGGER.setLevel(logging.ERROR)

    def unseen(*arguments: Any, **options: Any) -> Any:
        return ultralytics.utils.TQDM(*arguments, **options | {"disable": True})

    base.TQDM = unseen  # it shows these bars however quiet it is told to be
    return ultralytics
