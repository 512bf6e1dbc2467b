"""Coloured points of depth and colour. Pure."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.simulator.world import Camera

COLORED: Final = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<f4")])


def colored_points(depth: NDArray[Any], color: NDArray[np.uint8], camera: Camera) -> NDArray[Any]:
    metres = depth.astype(np.float32) / (1000 if depth.dtype == np.uint16 else 1)
    metres[metres == 0] = np.nan
    points = np.empty(depth.shape, COLORED)
    points["x"] = (np.arange(camera.width, dtype=np.float32) - camera.cx) / camera.fx * metres
    points["y"] = ((np.arange(camera.height, dtype=np.float32) - camera.cy) / camera.fy)[:, None] * metres
    points["z"] = metres
    r, g, b = (color[..., i].astype(np.uint32) for i in range(3))
    points["rgb"] = (r << 16 | g << 8 | b).view(np.float32)
    return points
