"""Keeps Ultralytics, torch and ONNX Runtime off the network: no downloads, installs or telemetry."""

import logging
import os
from pathlib import Path
from typing import NoReturn
from urllib.request import urlopen


def set_environment(folder: Path, *, download: bool) -> None:
    """Set the environment variables that they read on their first import.

    folder: where Ultralytics keeps its settings, so that they are nobody's but ours. download: weights alone may be
    fetched.
    """
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"
    os.environ["YOLO_OFFLINE"] = str(not download)
    os.environ["YOLO_AUTOINSTALL"] = "false"
    os.environ["YOLO_VERBOSE"] = "false"
    os.environ["YOLO_CONFIG_DIR"] = str(folder)
    os.environ["ULTRALYTICS_SAFE_LOAD"] = "true"  # weights are data: nothing in them is executed


def keep_offline(folder: Path, *, download: bool) -> None:
    """Set the environment variables, see `set_environment`, and keep torch from opening addresses. Takes seconds."""
    set_environment(folder, download=download)
    keep_torch_offline(download=download)


def keep_torch_offline(*, download: bool) -> None:
    """Keep torch and Ultralytics, once the environment is set, from opening addresses and from reporting."""
    from torch import hub  # noqa: PLC0415
    from ultralytics.nn import tasks  # noqa: PLC0415
    from ultralytics.utils import LOGGER, SETTINGS  # noqa: PLC0415

    vars(tasks)["SAFE_LOAD"] = True  # whoever imported it before
    vars(hub)["urlopen"] = urlopen if download else _refuse  # whatever part of a model asks torch's hub for weights
    SETTINGS["sync"] = False
    LOGGER.setLevel(logging.ERROR)


def _refuse(*_: object, **__: object) -> NoReturn:
    raise OSError("nothing is downloaded without --download")
