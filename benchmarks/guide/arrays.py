"""ROS messages as arrays and back, where the guide uses `ros_numpy`; in our words. Pure."""

from collections.abc import Sequence
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

PIXELS: Final = {"rgb8": ("u1", 3), "bgr8": ("u1", 3), "16UC1": ("u2", 1), "32FC1": ("f4", 1)}
"""Type and channels of a pixel, by the name of its encoding."""

FLOAT32: Final = 7
"""The number of sensor_msgs/PointField."""


class Field(Protocol):
    """A sensor_msgs/PointField."""

    name: str
    offset: int
    datatype: int


def pixels(data: bytes, encoding: str, height: int, width: int) -> NDArray[Any]:
    """Return an image's pixels, height x width, x channels where there is more than one; rows have no padding."""
    kind, channels = PIXELS[encoding]
    shape = (height, width) if channels == 1 else (height, width, channels)
    return np.frombuffer(data, f"<{kind}").reshape(shape)


def layout(fields: Sequence[Field], point_step: int) -> np.dtype[Any]:
    """Return what a point of a sensor_msgs/PointCloud2 looks like, as far as it is float32."""
    floats = [field for field in fields if field.datatype == FLOAT32]
    return np.dtype(
        {
            "names": [field.name for field in floats],
            "formats": ["<f4"] * len(floats),
            "offsets": [field.offset for field in floats],
            "itemsize": point_step,
        }
    )
