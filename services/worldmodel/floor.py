"""When each part of a site's floor was last looked at: blocks of cells, wherever robots see any. Pure."""

from collections import OrderedDict
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.distances import CameraView, DepthGrid
from schemas.world import LONG_AGO, MAX_CELLS, FloorLooks
from services.geometry.rotation import matrix_of

CELL_M: Final = 1.0
STEP: Final = 2
"""Every n-th column and row of a view's grid is a look."""

LOW_M: Final = 0.35
"""Lower points count as floor."""

FARTHEST_M: Final = 12.0
WIDEST_M: Final = 60.0
"""No camera shows floor that is farther from it than this along x or y, however wide its lens is said to be."""

BLOCK: Final = 32
"""Cells along each side of a block."""

MOST_BLOCKS: Final = MAX_CELLS // BLOCK**2
NEAR: Final = int(MOST_BLOCKS**0.5) // 2
"""Blocks that are no farther apart, in columns and rows, count as near each other."""

EVERY_NS: Final = 2_000_000_000
"""How often a camera's views count, at most."""


class Floor:
    """The floor of one site. Of more than MOST_BLOCKS blocks, those that were looked at longest ago are forgotten."""

    def __init__(self) -> None:
        # when each cell (BLOCK, BLOCK; row, column) was looked at, by the block's column and row; the latest are last
        self._blocks: OrderedDict[tuple[int, int], NDArray[np.int64]] = OrderedDict()
        self._due_ns: dict[tuple[str, str], int] = {}

    def take(self, view: CameraView, at_ns: int) -> None:
        """Note which cells a view shows the floor of."""
        camera = view.header.robot, view.header.camera
        if view.position is None or view.grid is None or at_ns < self._due_ns.get(camera, 0):
            return
        self._due_ns[camera] = at_ns + EVERY_NS
        pose = matrix_of(np.array(view.position), np.array(view.rotation))
        cells = np.unique(_seen(view.grid, pose), axis=0)
        blocks, number = np.unique(cells // BLOCK, axis=0, return_inverse=True)
        within = cells % BLOCK
        for each, (column, row) in enumerate(blocks.tolist()):
            x, y = within[number.ravel() == each].T
            self._block(column, row)[y, x] = at_ns

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now: the clock was set back."""
        for block in self._blocks.values():
            np.minimum(block, now_ns, out=block)
        self._due_ns.clear()

    def forget(self, cameras: Iterable[tuple[str, str]]) -> None:
        """Forget when cameras' views are due again."""
        for camera in cameras:
            self._due_ns.pop(camera, None)

    def _block(self, column: int, row: int) -> NDArray[np.int64]:
        block = self._blocks.get((column, row))
        if block is None:
            block = self._blocks[column, row] = np.zeros((BLOCK, BLOCK), np.int64)
            if len(self._blocks) > MOST_BLOCKS:
                self._blocks.popitem(last=False)
        self._blocks.move_to_end((column, row))
        return block

    def message(self, site: str, now_ns: int) -> FloorLooks:
        """Return the floor as others get it: a rectangle of at most MAX_CELLS.

        Where that is too small for all blocks, those are in it that are around the one with most others near it: floor
        seen far away by a robot with a wrong pose leaves room for the real floor.
        """
        low, looked_ns = self._rectangle()
        ages = np.clip((now_ns - looked_ns) // 1_000_000_000, 0, LONG_AGO)
        ages = np.where(looked_ns > 0, ages, LONG_AGO)
        rows, columns = ages.shape
        x, y = (low * CELL_M).tolist()
        return FloorLooks(
            site=site,
            now_ns=now_ns,
            origin=(x, y),
            cell_m=CELL_M,
            columns=columns,
            rows=rows,
            ages=memoryview(ages.astype("<u2").tobytes()),
        )

    def _rectangle(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the lowest cell (x, y) of a rectangle, and when its cells (row, column) were looked at."""
        if not self._blocks:
            return np.zeros(2, np.int64), np.zeros((0, 0), np.int64)
        blocks = np.array(list(reversed(self._blocks)), np.int64)
        apart = np.abs(blocks[:, np.newaxis] - blocks).max(axis=2)
        middle = np.count_nonzero(apart <= NEAR, axis=1).argmax()  # of several, the one looked at last
        blocks = blocks[np.argsort(apart[middle], kind="stable")]
        lows, highs = np.minimum.accumulate(blocks), np.maximum.accumulate(blocks)
        fitting = int(np.count_nonzero((highs - lows + 1).prod(axis=1) <= MOST_BLOCKS))
        low, (columns, rows) = lows[fitting - 1], (highs - lows + 1)[fitting - 1].tolist()
        looked_ns = np.zeros((rows, BLOCK, columns, BLOCK), np.int64)
        for column, row in blocks[:fitting].tolist():
            looked_ns[row - low[1], :, column - low[0]] = self._blocks[column, row]
        return low * BLOCK, looked_ns.reshape(rows * BLOCK, columns * BLOCK)


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
