"""ROS image encodings to the arrays that models expect."""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.image import BYTES_PER_PIXEL, ImageFrame

_TO_BGR: Final = {
    "rgb8": cv2.COLOR_RGB2BGR,
    "rgba8": cv2.COLOR_RGBA2BGR,
    "bgra8": cv2.COLOR_BGRA2BGR,
    "mono8": cv2.COLOR_GRAY2BGR,
}


def to_bgr(frame: ImageFrame) -> NDArray[np.uint8]:
    """Return the frame's pixels as a contiguous height x width x 3 array in blue, green, red order.

    BGR is what Ultralytics expects of numpy input (docs.ultralytics.com/modes/predict).
    """
    channels = BYTES_PER_PIXEL[frame.encoding]
    rows = np.frombuffer(frame.data, np.uint8).reshape(frame.height, frame.step)
    pixels = rows[:, : frame.width * channels].reshape(frame.height, frame.width, channels)
    code = _TO_BGR.get(frame.encoding)
    if code is None:
        return np.ascontiguousarray(pixels)
    return np.asarray(cv2.cvtColor(pixels, code), np.uint8)
