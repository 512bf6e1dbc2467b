"""A model that looks at one image at a time, on a thread of its own, behind the `Model` protocol."""

import asyncio
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from services.detector.account import FAILED, MALFORMED
from services.detector.model import Failed, Found, Outcome, Request
from services.detector.pixels import PictureError, to_bgr


class ImageModel(Protocol):
    """A model of single images. Used from one thread at a time."""

    @property
    def name(self) -> str:
        """What results say they come from."""

    def infer(self, image: NDArray[np.uint8], *, masks: bool) -> list[Detection]:
        """Return the objects in a height x width x 3 BGR image, best score first, with masks if asked for and known."""


class OneByOne:
    """Has an executor run the model on each image of a batch."""

    max_batch = 1
    in_flight = 1

    def __init__(self, model: ImageModel, executor: Executor) -> None:
        self._model = model
        self._executor = executor
        self.name = model.name

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`."""
        loop = asyncio.get_running_loop()
        return [await loop.run_in_executor(self._executor, self._look_at, request) for request in batch]

    def _look_at(self, request: Request) -> Outcome:
        begun_ns = time.perf_counter_ns()
        try:
            objects = self._model.infer(to_bgr(request.frame), masks=request.masks)
        except PictureError as error:
            return Failed(MALFORMED, error)
        except Exception as error:  # noqa: BLE001 - whatever a frame does to the model, it fails alone
            return Failed(FAILED, error)
        return Found(objects, {"model": time.perf_counter_ns() - begun_ns})
