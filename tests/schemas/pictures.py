"""Files of pictures for tests."""

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.image import ImageFrame
from tests.schemas.frames import header


def file_of(pixels: NDArray[np.generic], extension: str) -> bytes:
    """Return a file of height x width (x 3 or 4, blue first) pixels."""
    made, data = cv2.imencode(extension, np.asarray(pixels))
    assert made
    return data.tobytes()


def compressed(
    data: bytes, encoding: str, step: int, *, kind: str = "png", height: int = 4, width: int = 6, **more: object
) -> ImageFrame:
    """Return a frame of a file."""
    fields = {"height": height, "width": width, "encoding": encoding, "step": step, "format": kind, **more}
    return ImageFrame(header=header(), data=memoryview(data), **fields)  # type: ignore[arg-type]
