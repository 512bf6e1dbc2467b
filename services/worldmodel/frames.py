"""Views of several cameras as arrays: their objects, poses and grids of depth, one after another. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from schemas.distances import REACHES, CameraView
from services.geometry.rotation import matrix_of

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]

FIELDS: Final = 11 + REACHES
"""Columns of `Frames.objects`: x, y, z, depth, low, high, score, box (4), reaches in millimetres."""

_BLIND: Final = np.zeros(1, np.uint16)
"""The grid of a view without one: a single cell without a reading."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Some views that have a position. views: themselves. at_ns: when each was taken, on the model's clock.

    robots: numbers, each once. cameras: numbers. camera: (views, 3) positions. rotation: (views, 3, 3) from the optical
    frame into the map. objects: (objects, FIELDS). frame_of: the view of each. columns, rows, fx, fy, cx, cy: of each
    view's grid. starts: of each one's cells in near_mm and far_mm.
    """

    views: Sequence[CameraView]
    at_ns: NDArray[np.int64]
    robots: Rows
    cameras: Rows
    camera: Floats
    rotation: Floats
    objects: Floats
    frame_of: Rows
    columns: Rows
    rows: Rows
    lens: Floats
    starts: Rows
    near_mm: NDArray[np.uint16]
    far_mm: NDArray[np.uint16]

    @classmethod
    def of(
        cls, views: Sequence[CameraView], at_ns: Sequence[int], robots: Sequence[int], cameras: Sequence[int]
    ) -> Self:
        """Return the arrays of views that have a position."""
        poses = np.array([(*(view.position or ()), *view.rotation) for view in views], np.float64).reshape(-1, 7)
        rotation = np.stack([matrix_of(pose[:3], pose[3:])[:3, :3] for pose in poses]) if len(poses) else poses
        counts = [len(view.objects) for view in views]
        table = [
            (*each.at, each.depth_m, each.low_m, each.high_m, each.score, *each.box, *each.reach_mm)
            for view in views
            for each in view.objects
        ]
        grids = [view.grid for view in views]
        sizes = [(1, 1) if grid is None else (grid.columns, grid.rows) for grid in grids]
        lens = [(1.0, 1.0, 0.5, 0.5) if grid is None else (grid.fx, grid.fy, grid.cx, grid.cy) for grid in grids]
        columns, rows = np.array(sizes, np.intp).reshape(-1, 2).T
        ends = np.cumsum(columns * rows)
        return cls(
            views=views,
            at_ns=np.array(at_ns, np.int64),
            robots=np.array(robots, np.intp),
            cameras=np.array(cameras, np.intp),
            camera=poses[:, :3],
            rotation=rotation,
            objects=np.array(table, np.float64).reshape(len(table), FIELDS),
            frame_of=np.repeat(np.arange(len(views)), counts),
            columns=columns,
            rows=rows,
            lens=np.array(lens, np.float64).reshape(-1, 4),
            starts=ends - columns * rows,
            near_mm=np.concatenate([_cells(None if grid is None else grid.near_mm) for grid in grids]),
            far_mm=np.concatenate([_cells(None if grid is None else grid.far_mm) for grid in grids]),
        )

    def __len__(self) -> int:
        return len(self.at_ns)

    def moved(self, offsets: Floats) -> tuple[Floats, Floats]:
        """Return the cameras' positions and rotations, corrected by their robots' offsets (views, 3; x, y, yaw)."""
        cos, sin = np.cos(offsets[:, 2]), np.sin(offsets[:, 2])
        turned = np.zeros((len(self), 3, 3))
        turned[:, 0, 0] = turned[:, 1, 1] = cos
        turned[:, 0, 1], turned[:, 1, 0], turned[:, 2, 2] = -sin, sin, 1.0
        camera = self.camera.copy()
        camera[:, :2] += offsets[:, :2]
        return camera, turned @ self.rotation


def rounds(views: Sequence[tuple[CameraView, int]]) -> Iterator[list[tuple[CameraView, int]]]:
    """Yield views, and when each was taken, in groups in which no robot is twice; a robot's stay in their order."""
    rest = views
    while rest:
        now: dict[str, tuple[CameraView, int]] = {}
        later = []
        for each in rest:
            robot = each[0].header.robot
            if robot in now:
                later.append(each)
            else:
                now[robot] = each
        rest = later
        yield list(now.values())


def _cells(depths: memoryview | None) -> NDArray[np.uint16]:
    return _BLIND if depths is None else np.frombuffer(depths, "<u2")
