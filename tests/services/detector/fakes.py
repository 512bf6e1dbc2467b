"""A model whose answers are known: the tests of the worker run on it, the real one passes the same contract."""

import threading

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Box, Detection, Mask
from services.detector.masks import to_coco


class FakeModel:
    """Finds one box in every image, as large as the image; fails on images whose first pixel is FATAL."""

    FATAL = (13, 13, 13)

    def __init__(self) -> None:
        self.name = "fake"
        self.seen: list[NDArray[np.uint8]] = []
        self.may_answer = threading.Event()
        self.may_answer.set()
        self.called = threading.Semaphore(0)

    def infer(self, image: NDArray[np.uint8], *, masks: bool) -> list[Detection]:
        """See `Model.infer`."""
        self.seen.append(image)
        self.called.release()
        self.may_answer.wait(10)
        if tuple(image[0, 0]) == self.FATAL:
            raise RuntimeError("this image is fatal")
        height, width = image.shape[:2]
        mask: Mask | None = to_coco(np.ones((1, height, width), np.uint8))[0] if masks else None
        return [Detection(name="box", score=0.75, box=Box(0, 0, width, height), mask=mask)]
