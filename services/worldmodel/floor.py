"""When each part of a site's floor was last looked at: a grid that grows with what robots see. Pure."""

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.distances import CameraView, DepthGrid
from schemas.world import MAX_CELLS, FloorLooks
from services.geometry.rotation import matrix_of

CELL_M: Final = 1.0
STEP: Final = 2
"""Every so manieth column and row of a view's grid is a look."""

LOW_M: Final = 0.35
"""What is lower counts as floor."""

FARTHEST_M: Final = 12.0
WIDEST_M: Final = 60.0
"""No camera shows floor that is farther from it than this along x or y, however wide its lens is said to be."""

BLOCK: Final = 32
"""Cells by which the grid grows."""

EVERY_NS: Final = 2_000_000_000
"""How often a camera's views count, at most."""

LONG_AGO: Final = 65_535


class Floor:
    """The floor of one site. Far places beyond MAX_CELLS in all are left out."""

    def __init__(self) -> None:
        self._low = np.zeros(2, np.int64)
        self._looked_ns = np.zeros((0, 0), np.int64)
        self._due_ns: dict[tuple[str, str], int] = {}

    def take(self, view: CameraView, at_ns: int) -> None:
        """Note which cells a view shows the floor of."""
        camera = view.header.robot, view.header.camera
        if view.position is None or view.grid is None or at_ns < self._due_ns.get(camera, 0):
            return
        self._due_ns[camera] = at_ns + EVERY_NS
        pose = matrix_of(np.array(view.position), np.array(view.rotation))
        cells = np.unique(_seen(view.grid, pose), axis=0)
        if len(cells) and self._reach(cells.min(axis=0), cells.max(axis=0)):
            x, y = (cells - self._low).T
            self._looked_ns[y, x] = at_ns

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now: the clock was set back."""
        np.minimum(self._looked_ns, now_ns, out=self._looked_ns)
        self._due_ns.clear()

    def forget(self, cameras: Iterable[tuple[str, str]]) -> None:
        """Forget when cameras' views are due again."""
        for camera in cameras:
            self._due_ns.pop(camera, None)

    def _reach(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> bool:
        """Make the grid reach from one cell to another; return whether it may be so large."""
        rows, columns = self._looked_ns.shape
        end = self._low + np.array([columns, rows])
        if columns and (low >= self._low).all() and (high < end).all():
            return True
        new_low = np.floor_divide(low, BLOCK) * BLOCK
        new_end = (np.floor_divide(high, BLOCK) + 1) * BLOCK
        if columns:
            new_low, new_end = np.minimum(new_low, self._low), np.maximum(new_end, end)
        wide, tall = (new_end - new_low).tolist()
        if wide * tall > MAX_CELLS:
            return False
        grown = np.zeros((tall, wide), np.int64)
        if columns:
            x, y = self._low - new_low
            grown[y : y + rows, x : x + columns] = self._looked_ns
        self._low, self._looked_ns = new_low, grown
        return True

    def message(self, site: str, now_ns: int) -> FloorLooks:
        """Return the grid as others get it."""
        ages = np.clip((now_ns - self._looked_ns) // 1_000_000_000, 0, LONG_AGO)
        ages = np.where(self._looked_ns > 0, ages, LONG_AGO)
        rows, columns = ages.shape
        x, y = (self._low * CELL_M).tolist()
        return FloorLooks(
            site=site,
            now_ns=now_ns,
            origin=(x, y),
            cell_m=CELL_M,
            columns=columns,
            rows=rows,
            ages=memoryview(ages.astype("<u2").tobytes()),
        )


def _seen(grid: DepthGrid, pose: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the cells (n, 2; x, y) of which a camera at a pose (4 x 4) shows the floor."""
    far = np.frombuffer(grid.far_mm, "<u2").reshape(grid.rows, grid.columns)[::STEP, ::STEP] / 1000
    columns, rows = np.arange(0, grid.columns, STEP) + 0.5, np.arange(0, grid.rows, STEP) + 0.5
    with np.errstate(over="ignore", invalid="ignore"):  # of a lens that cannot be
        x, y = np.meshgrid((columns - grid.cx) / grid.fx, (rows - grid.cy) / grid.fy)
        optical = np.stack([x * far, y * far, far], axis=2)[(far > 0) & (far < FARTHEST_M)]
        away = optical @ pose[:3, :3].T
    low = (away[:, 2] + pose[2, 3] < LOW_M) & (np.abs(away[:, :2]) < WIDEST_M).all(axis=1)
    return np.floor((away[low, :2] + pose[:2, 3]) / CELL_M).astype(np.int64)
