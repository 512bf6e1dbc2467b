"""Shortest ways over the free floor that keep their distance from things."""

from heapq import heappop, heappush
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.simulator.world.clearance import Clearance

STRIDE: Final = 4
NEIGHBOURS: Final = tuple((r, c, float(np.hypot(r, c))) for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c)
Cell = tuple[int, int]


class RouteMap:
    """A coarse grid of the largest connected free area; cells are (row, column) of that grid."""

    def __init__(self, clearance: Clearance, margin: float) -> None:
        self._clearance = clearance
        room = clearance.grid[::STRIDE, ::STRIDE]
        _, areas, stats, _ = cv2.connectedComponentsWithStats((room > margin).astype(np.uint8), connectivity=4)
        largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()) if len(stats) > 1 else -1
        self.free: NDArray[np.bool_] = areas == largest
        self._cost = np.where(self.free, 1 + 0.4 / np.maximum(room, 0.05), np.inf)

    def points(self, cells: NDArray[np.intp]) -> NDArray[np.float64]:
        """Map points (n, 2) of cells (n, 2)."""
        return self._clearance.points(cells * STRIDE)

    def route(self, start: Cell, goal: Cell) -> list[Cell]:
        """The cells from `start` to `goal`, both of which are free."""
        came_from: dict[Cell, Cell] = {}
        best = {start: 0.0}
        queue = [(0.0, start)]
        while queue:
            _, cell = heappop(queue)
            if cell == goal:
                break
            for row, column, length in NEIGHBOURS:
                there = (cell[0] + row, cell[1] + column)
                if not self._is_free(there):
                    continue
                cost = best[cell] + length * float(self._cost[there])
                if cost < best.get(there, np.inf):
                    best[there], came_from[there] = cost, cell
                    ahead = np.hypot(there[0] - goal[0], there[1] - goal[1])
                    heappush(queue, (cost + float(ahead), there))
        path = [goal]
        while path[-1] != start:
            path.append(came_from[path[-1]])
        return path[::-1]

    def _is_free(self, cell: Cell) -> bool:
        rows, columns = self.free.shape
        return 0 <= cell[0] < rows and 0 <= cell[1] < columns and bool(self.free[cell])
