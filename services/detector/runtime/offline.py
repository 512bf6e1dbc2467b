"""Keeps Ultralytics and ONNX Runtime off the network: no downloads, installs or telemetry."""

import logging
import os
from pathlib import Path


def keep_offline(folder: Path, *, download: bool) -> None:
    """Set the environment variables that both read on their first import.

    folder: where Ultralytics keeps its settings, so that they are nobody's but ours. download: weights alone may be
    fetched.
    """
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"
    os.environ["YOLO_OFFLINE"] = str(not download)
    os.environ["YOLO_AUTOINSTALL"] = "false"
    os.environ["YOLO_VERBOSE"] = "false"
    os.environ["YOLO_CONFIG_DIR"] = str(folder)
    os.environ["ULTRALYTICS_SAFE_LOAD"] = "true"  # weights are data: nothing in them is executed
    from ultralytics.nn import tasks  # noqa: PLC0415
    from ultralytics.utils import LOGGER, SETTINGS  # noqa: PLC0415

    vars(tasks)["SAFE_LOAD"] = True  # whoever imported it before
    SETTINGS["sync"] = False
    LOGGER.setLevel(logging.ERROR)
