"""The organised point cloud of a depth image."""

from functools import lru_cache

import numpy as np

from services.simulator.world.camera import Camera
from services.simulator.world.cuboids import Floats


def organised_cloud(depth: Floats, camera: Camera) -> Floats:
    """Points (height, width, 3) in metres of the optical frame, NaN where `depth` (0 or NaN) has none.

    The colour of each point is that of its pixel in the colour image that the depth is registered to.
    """
    cloud = _rays(camera) * depth[..., None]
    cloud[~(depth > 0)] = np.nan
    return np.asarray(cloud, np.float32)


@lru_cache(maxsize=8)
def _rays(camera: Camera) -> Floats:
    x, y = (np.arange(camera.width) - camera.cx) / camera.fx, (np.arange(camera.height) - camera.cy) / camera.fy
    return np.stack([*np.meshgrid(x, y), np.ones((camera.height, camera.width))], axis=-1).astype(np.float32)
