"""Frames as arrays and back. Pure."""

from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.image import BYTES_PER_PIXEL, ImageFrame

_CHANNELS: Final = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "yuv422": 2}


def pixels_of(frame: ImageFrame) -> NDArray[Any]:
    """Return a raw frame's pixels, height x width x channels, as a view; 16 and 32 bits in their own byte order."""
    size = BYTES_PER_PIXEL[frame.encoding]
    rows = np.frombuffer(frame.data, np.uint8).reshape(frame.height, frame.step)
    pixels = rows[:, : frame.width * size].reshape(frame.height, frame.width, size)
    if frame.encoding in _CHANNELS or size == 1:
        return pixels
    order = ">" if frame.is_bigendian else "<"
    return pixels.view(f"{order}f4" if frame.encoding == "32FC1" else f"{order}u2")


def with_pixels(frame: ImageFrame, pixels: NDArray[Any]) -> ImageFrame:
    """Return the frame with other pixels of the same kind, rows without padding."""
    height, width = pixels.shape[:2]
    packed: Any = np.ascontiguousarray(pixels)
    return msgspec.structs.replace(
        frame,
        height=height,
        width=width,
        step=width * BYTES_PER_PIXEL[frame.encoding],
        data=memoryview(packed.reshape(-1).view(np.uint8)),
    )
