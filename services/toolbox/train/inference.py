"""The detector's own path from a camera's image to detections, for measurements."""

import asyncio
from collections.abc import Callable, Iterable, Sequence
from itertools import count
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from services.detector.model import DetectedObjects, Failed, ModelError, Outcome, Request
from services.detector.runtime.loading import load, tracking
from services.detector.runtime.pipeline import Pipeline
from services.detector.runtime.refinement.refiner import Refiner
from services.detector.settings import DetectorSettings
from services.detector.tracking.confirmed_tracks import NEUTRAL
from services.simulator.world import CLASSES
from services.training.evaluation.precision import MAX_DETECTIONS
from services.training.evaluation.predictor import Predictor

NAMED: Final = 5
CAMERA: Final = CameraKey("r1", "camera")
HEADER: Final = Header(robot="r1", camera="camera", boot_id="", seq=0, stamp_ns=0, frame_id="", received_ns=0)

Follow = Callable[[Iterable[NDArray[np.uint8]], float], Sequence[Sequence[Detection]]]
"""Finds and follows the objects in pictures that a camera takes so many of a second: `Predictor`, with tracks."""


def open_weights(
    weights: Path,
    *,
    confidence: float,
    device: str | None,
    folder: Path,
    any_model: bool = False,
    runtime: str = "torch",
) -> Predictor:
    """Load `weights` as a detector does, for one thread and a runtime; see `PredictorLoader`.

    Raises:
        ModelError: no model, or, unless any will do, none that finds masks of the simulated world's classes.
    """
    settings = _settings(weights, device, confidence=confidence, max_detections=MAX_DETECTIONS, runtime=runtime)
    model = load(settings, folder) if any_model else _loaded(settings, folder)

    def predict(image: NDArray[np.uint8]) -> Sequence[Detection]:
        (outcome,) = model.run([Request(CAMERA, framed(image), masks=True)])
        return objects_of(weights, outcome)

    return predict


def open_follower(weights: Path, *, device: str | None, folder: Path, runtime: str = "torch") -> Follow:
    """Load `weights` as a detector does, with its own tracker and confidence, for one thread and a runtime.

    Raises:
        ModelError: no model, or none that finds masks of the simulated world's classes.
    """
    settings = _settings(weights, device, runtime=runtime, track_score=NEUTRAL)  # as if they were shipped already
    model = _loaded(settings, folder)
    following = tracking(settings, model)
    drives = count()

    def follow(images: Iterable[NDArray[np.uint8]], hz: float) -> list[Sequence[Detection]]:
        camera = CameraKey(CAMERA.robot, f"camera{next(drives)}")
        return asyncio.run(_followed(images, hz, camera))

    async def _followed(images: Iterable[NDArray[np.uint8]], hz: float, camera: CameraKey) -> list[Sequence[Detection]]:
        found = []
        for seq, image in enumerate(images):
            header = msgspec.structs.replace(HEADER, seq=seq, received_ns=round(seq * 1e9 / hz))
            request = Request(camera, framed(image, header), masks=True)
            (outcome,) = await model.infer([request])
            if following is not None and isinstance(outcome, DetectedObjects):
                outcome = await following.follow(request, outcome)
            found.append(objects_of(weights, outcome))
        return found

    return follow


def _settings(weights: Path, device: str | None, **more: float | str) -> DetectorSettings:
    return DetectorSettings.model_validate(
        {"model": str(weights), "device": device, "threads": 1, "runtime": "torch", **more}
    )


def open_model(
    weights: Path, device: str | None, *, folder: Path, refiner: Refiner | None = None, **more: float | str
) -> Pipeline:
    """Load `weights` as a detector does, for one thread. refiner: replaces that of the weights.

    Raises:
        ModelError: no model, or none that finds masks of the simulated world's classes.
    """
    return _loaded(_settings(weights, device, **more), folder, refiner)


def _loaded(settings: DetectorSettings, folder: Path, refiner: Refiner | None = None) -> Pipeline:
    model = load(settings, folder, refiner)
    if (task := model.facts.task).kind != "segment":
        raise ModelError(f"{settings.model}: a model for {task.title}, not for segmentation")
    if unknown := sorted(set(model.facts.names.values()).difference(CLASSES)):
        names = ", ".join(unknown[:NAMED]) + (", ..." if len(unknown) > NAMED else "")
        raise ModelError(f"{settings.model}: a model for {names}; the scenes have {', '.join(CLASSES)} alone")
    return model


def objects_of(weights: Path, outcome: Outcome) -> Sequence[Detection]:
    """Return the detections.

    Raises:
        ModelError: it could not be looked for.
    """
    if isinstance(outcome, Failed):
        raise ModelError(f"{weights}: {outcome.reason}: {outcome.error}") from outcome.error
    return outcome.objects


def framed(image: NDArray[np.uint8], header: Header = HEADER) -> ImageFrame:
    """A height x width x 3 RGB picture as a camera would send it."""
    height, width = image.shape[:2]
    data = memoryview(image.tobytes())
    return ImageFrame(header=header, height=height, width=width, encoding="rgb8", step=3 * width, data=data)
