"""Where rays meet cuboids, by the slabs of each: slow, and another way than the renderer's."""

import numpy as np
from numpy.typing import NDArray

from services.simulator.world import Camera, Pose
from services.simulator.world.cuboids import Cuboids

Array = NDArray[np.float64]


def cast(cuboids: Cuboids, origin: Array, directions: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return, for each of `directions` (n, 3), how many of its lengths the first cuboid is away, and which it is.

    Infinity and -1 where there is none. Cuboids around the origin are not seen, as their faces look away from it.
    """
    best, hit = np.full(len(directions), np.inf), np.full(len(directions), -1)
    for index in range(len(cuboids)):
        rotation = cuboids.rotations[index].astype(np.float64)
        start = (origin - cuboids.centres[index]) @ rotation
        way = directions @ rotation
        way = np.where(way == 0, 1e-12, way)
        ends = np.stack([(side * cuboids.half_extents[index] - start) / way for side in (-1, 1)])
        entry, leaving = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
        nearer = (entry <= leaving) & (entry > 0) & (entry < best)
        best[nearer], hit[nearer] = entry[nearer], index
    return best, hit


def pixel_rays(columns: Array, rows: Array, pose: Pose, camera: Camera) -> Array:
    """Return the rays through pixels (n,) as (n, 3) in the map, 1 m long along the optical axis."""
    rays = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(len(rows))], axis=1)
    return np.asarray(rays @ pose.rotation.T.astype(np.float64))
