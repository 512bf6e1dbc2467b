"""Free space on the floor: the distance from any point to the nearest obstacle of a robot."""

from dataclasses import dataclass
from typing import Final, Self

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.simulator.world.cuboids import Floats
from services.simulator.world.scene import Scene

CELLS_PER_METRE: Final = 20
ROBOT_HEIGHT: Final = 1.6
STEP_HEIGHT: Final = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Clearance:
    """`grid[row, column]` is metres to the nearest obstacle or wall; rows run along y, columns along x."""

    grid: Floats
    half_x: float
    half_y: float

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Measure `scene` for a robot lower than `ROBOT_HEIGHT`."""
        columns, rows = int(2 * scene.half_x * CELLS_PER_METRE), int(2 * scene.half_y * CELLS_PER_METRE)
        free = np.ones((rows, columns), np.uint8)
        free[0], free[-1], free[:, 0], free[:, -1] = 0, 0, 0, 0
        corners = scene.cuboids.corners()
        in_the_way = (corners[..., 2].min(axis=1) < ROBOT_HEIGHT) & (corners[..., 2].max(axis=1) > STEP_HEIGHT)
        for outline in corners[in_the_way][..., :2] * CELLS_PER_METRE + (columns / 2, rows / 2):
            cv2.fillConvexPoly(free, cv2.convexHull(np.rint(outline).astype(np.int32)), 0)
        distance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) / CELLS_PER_METRE
        return cls(distance.astype(np.float32), scene.half_x, scene.half_y)

    def cells(self, points: ArrayLike) -> NDArray[np.intp]:
        """The (row, column) of map points (..., 2), held inside the hall."""
        xy = np.add(np.asarray(points, np.float64), (self.half_x, self.half_y)) * CELLS_PER_METRE
        limit = np.array(self.grid.shape) - 1
        return np.asarray(np.clip(np.floor(xy[..., ::-1]), 0, limit), np.intp)

    def points(self, cells: NDArray[np.intp]) -> NDArray[np.float64]:
        """The map points (..., 2) at the middle of cells (..., 2) of (row, column)."""
        return (cells[..., ::-1] + 0.5) / CELLS_PER_METRE - (self.half_x, self.half_y)

    def at(self, points: ArrayLike) -> Floats:
        """Metres of free space around map points (..., 2)."""
        rows, columns = np.moveaxis(self.cells(points), -1, 0)
        return np.asarray(self.grid[rows, columns], np.float32)
