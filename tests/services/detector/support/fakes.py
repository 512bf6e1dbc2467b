"""A model whose answers are known: the tests of the worker run on it, the real one passes the same contract."""

import asyncio
import threading
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Box, Detection
from schemas.tuning import Tuning
from services.detector.frame_counts import FAILED, MALFORMED
from services.detector.model import DetectedObjects, Failed, ModelError, Outcome, Request, TuningError
from services.detector.pixels import ImageDecodeError, to_bgr
from services.detector.runtime.masks import encode_all
from services.geometry.masks import Window

BOX = "box"


class FakeModel:
    """Finds one box in every image, as large as the image; fails on images whose first pixel is FATAL."""

    FATAL = (13, 13, 13)

    def __init__(self, *, segments: bool = True, remarks: tuple[str, ...] = (), broken: bool = False) -> None:
        self.name = "fake"
        self.runtime = "fake"
        self.max_batch = 1
        self.in_flight = 1
        self.segments = segments
        self.remarks = remarks
        self.broken = broken
        self.tuning = Tuning(confidence=0.5, iou=0.7, max_detections=300, classes=[])
        self.seen: list[NDArray[np.uint8]] = []
        self.may_answer = threading.Event()
        self.may_answer.set()
        self.called = threading.Semaphore(0)
        self._turn = asyncio.Lock()

    @property
    def classes(self) -> tuple[str, ...]:
        """See `Model.classes`."""
        return tuple(self.tuning.classes or [BOX])

    def tune(self, tuning: Tuning) -> None:
        """See `Model.tune`."""
        unknown = set(tuning.classes or []) - {BOX}
        if unknown:
            raise TuningError(f"no class is called {unknown.pop()!r}; the model knows {BOX}")
        given = {name: value for name, value in msgspec.structs.asdict(tuning).items() if value is not None}
        self.tuning = msgspec.structs.replace(self.tuning, **given)

    def close(self) -> None:
        """See `Model.close`."""

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        """See `Model.infer`."""
        if self.broken:
            raise ModelError("no memory")
        async with self._turn:
            return await asyncio.to_thread(lambda: [self._look(request) for request in batch])

    def _look(self, request: Request) -> Outcome:
        self.called.release()
        try:
            image = to_bgr(request.frame)
        except ImageDecodeError as error:
            return Failed(MALFORMED, error)
        self.seen.append(image)
        self.may_answer.wait(60)
        if tuple(image[0, 0]) == self.FATAL:
            return Failed(FAILED, RuntimeError("this image is fatal"))
        height, width = image.shape[:2]
        (mask,) = encode_all([Window(0, 0, np.ones((height, width), np.bool_))], height, width)
        wanted = request.masks and self.segments
        found = Detection(name=BOX, score=0.75, box=Box(0, 0, width, height), mask=mask if wanted else None)
        return DetectedObjects([found], {"model": 1_000})
