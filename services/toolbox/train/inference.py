"""The detector's own way from a camera's picture to detections, for those who measure it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from services.detector.model import Failed, ModelError, Request
from services.detector.runtime.loading import load
from services.detector.settings import DetectorSettings
from services.simulator.training.evaluation.looking import Look
from services.simulator.training.evaluation.precision import MAX_DETECTIONS
from services.simulator.world import CLASSES

NAMED: Final = 5
CAMERA: Final = CameraKey("r1", "camera")
HEADER: Final = Header(robot="r1", camera="camera", boot_id="", seq=0, stamp_ns=0, frame_id="", received_ns=0)


def open_weights(weights: Path, *, confidence: float, device: str | None, folder: Path) -> Look:
    """Load `weights` as a detector does, for one thread; see `Opener`.

    Raises:
        ModelError: no model, or none that finds masks of the simulated world's classes.
    """
    settings = DetectorSettings(
        model=str(weights),
        confidence=confidence,
        max_detections=MAX_DETECTIONS,
        device=device,
        threads=1,
        runtime="torch",
    )
    model = load(settings, folder)
    if not model.segments:
        raise ModelError(f"{weights}: a model that finds no masks")
    if unknown := sorted(set(model.facts.names.values()).difference(CLASSES)):
        names = ", ".join(unknown[:NAMED]) + (", ..." if len(unknown) > NAMED else "")
        raise ModelError(f"{weights}: a model for {names}; the scenes have {', '.join(CLASSES)} alone")

    def look(image: NDArray[np.uint8]) -> Sequence[Detection]:
        (outcome,) = model.run([Request(CAMERA, framed(image), masks=True)])
        if isinstance(outcome, Failed):
            raise ModelError(f"{weights}: {outcome.reason}: {outcome.error}") from outcome.error
        return outcome.objects

    return look


def framed(image: NDArray[np.uint8]) -> ImageFrame:
    """A height x width x 3 RGB picture as a camera would send it."""
    height, width = image.shape[:2]
    data = memoryview(image.tobytes())
    return ImageFrame(header=HEADER, height=height, width=width, encoding="rgb8", step=3 * width, data=data)
