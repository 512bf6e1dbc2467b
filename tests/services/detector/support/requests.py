"""Images as a model is asked about them."""

import numpy as np
from numpy.typing import NDArray

from schemas.image import ImageFrame
from schemas.keys import CameraKey
from services.detector.model import Request
from tests.schemas.frames import header

FRONT = CameraKey("r1", "front")


def frame_of(pixels: NDArray[np.uint8], encoding: str = "bgr8", *, seq: int = 0) -> ImageFrame:
    """Return an image's pixels as a frame."""
    height, width, channels = pixels.shape
    return ImageFrame(
        header=header(seq=seq),
        height=height,
        width=width,
        encoding=encoding,
        step=width * channels,
        data=memoryview(np.ascontiguousarray(pixels).tobytes()),
    )


def request(pixels: NDArray[np.uint8], encoding: str = "bgr8", *, masks: bool = False) -> Request:
    """Ask about an image's pixels."""
    return Request(FRONT, frame_of(pixels, encoding), masks)
