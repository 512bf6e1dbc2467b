"""The model that Ultralytics runs. Only `load` imports torch and ultralytics, and it keeps both off the network."""

import os
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from schemas.detections import MAX_DETECTIONS, Box, Detection
from services.detector.masks import to_coco
from services.detector.model import ModelError
from services.detector.one_by_one import ImageModel
from services.detector.settings import DetectorSettings

TASKS: Final = ("segment", "detect")
BLANK: Final[NDArray[np.uint8]] = np.zeros((480, 640, 3), np.uint8)


class UltralyticsModel:
    """An Ultralytics model behind the `ImageModel` protocol."""

    def __init__(self, yolo: Any, settings: DetectorSettings) -> None:
        self._yolo = yolo
        self._options = {
            "conf": settings.confidence,
            "iou": settings.iou,
            "max_det": min(settings.max_detections, MAX_DETECTIONS),
            "device": settings.device,
            "retina_masks": True,  # masks in the image's own resolution, not the letterboxed one
            "verbose": False,
        }
        self.name = Path(settings.model).name

    def infer(self, image: NDArray[np.uint8], *, masks: bool) -> list[Detection]:
        """See `ImageModel.infer`."""
        result = self._yolo.predict(source=image, **self._options)[0].cpu().numpy()
        boxes = result.boxes
        outlines = to_coco(result.masks.data.astype(np.uint8)) if masks and result.masks is not None else None
        found = [
            Detection(
                name=result.names[int(boxes.cls[index])],
                score=float(boxes.conf[index]),
                box=Box(*(float(edge) for edge in boxes.xyxy[index])),
                mask=outlines[index] if outlines else None,
                label=int(boxes.cls[index]),
            )
            for index in range(len(boxes))
        ]
        return sorted(found, key=lambda detection: -detection.score)


def load(settings: DetectorSettings, folder: Path) -> ImageModel:
    """Load the model and run it once, so that the first real frame does not wait. Takes seconds; call it off the loop.

    folder: where Ultralytics keeps its settings, so that they are nobody's but ours.

    Raises:
        ModelError: the file is no model, or of a task that finds no objects.
    """
    _keep_off_the_network(folder, download=settings.download)
    import torch  # noqa: PLC0415
    from ultralytics.models import YOLO  # noqa: PLC0415
    from ultralytics.utils import SETTINGS  # noqa: PLC0415

    SETTINGS["sync"] = False
    try:
        yolo = YOLO(settings.model)
        model = UltralyticsModel(yolo, settings)
        model.infer(BLANK, masks=False)
    except Exception as error:
        raise ModelError(f"--model {settings.model}: not a model that can be used: {_first_line(error)}") from error
    if yolo.task not in TASKS:
        raise ModelError(f"--model {settings.model}: a model for {yolo.task!r}, not for one of {', '.join(TASKS)}")
    torch.set_num_threads(settings.threads or os.cpu_count() or 1)  # the first call left it at cores - 1
    return model


def _keep_off_the_network(folder: Path, *, download: bool) -> None:
    os.environ["YOLO_OFFLINE"] = str(not download)
    os.environ["YOLO_AUTOINSTALL"] = "false"
    os.environ["YOLO_VERBOSE"] = "false"
    os.environ["YOLO_CONFIG_DIR"] = str(folder)
    os.environ["ULTRALYTICS_SAFE_LOAD"] = "true"  # weights are data: nothing in them is executed


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
