"""Files of pictures for tests."""

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.image import ImageFrame
from tests.schemas.frames import header

SCAN = b"\xff\xda"


def file_of(pixels: NDArray[np.generic], extension: str) -> bytes:
    """Return a file of height x width (x 3 or 4, blue first) pixels."""
    made, data = cv2.imencode(extension, np.asarray(pixels))
    assert made
    return data.tobytes()


def resized(file: bytes, height: int, width: int) -> bytes:
    """Return a progressive JPEG file that says to be of another size."""
    place = file.index(b"\xff\xc2") + 5
    return file[:place] + height.to_bytes(2, "big") + width.to_bytes(2, "big") + file[place + 4 :]


def compressed(
    data: bytes, encoding: str, step: int, *, kind: str = "png", height: int = 4, width: int = 6, **more: object
) -> ImageFrame:
    """Return a frame of a file."""
    fields = {"height": height, "width": width, "encoding": encoding, "step": step, "format": kind, **more}
    return ImageFrame(header=header(), data=memoryview(data), **fields)  # type: ignore[arg-type]
