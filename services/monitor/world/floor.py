"""When the floor of zones was looked at. Pure."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.world import LONG_AGO, FloorLooks
from services.monitor.world.zones import Zone

NS: Final = 1_000_000_000

LEAST_COVERED: Final = 0.5
"""Share of a zone's area that cells whose centres are in it have to cover; else all cells that it touches count."""

MOST_CELLS: Final = 250_000
"""Cells of the rectangle around a zone; of a larger zone only what is in the grid is looked at."""


@dataclass(frozen=True, slots=True)
class ZoneFloor:
    """The floor of a zone. ages_s: of the last look at each cell that may have been seen. cells: how many it has.

    corner: the lowest one of the cells around the zone, in the map. cell_m: side of a cell.
    """

    at_ns: int
    ages_s: NDArray[np.float64]
    cells: float
    corner: tuple[float, float]
    cell_m: float

    def with_earlier(self, before: "ZoneFloor") -> "ZoneFloor":
        """Return this floor with looks that were told before: a worker that takes a site over knows of none."""
        same_cells = self.cell_m == before.cell_m and np.allclose(self.corner, before.corner, rtol=0)
        if not same_cells or self.ages_s.shape != before.ages_s.shape:
            return self
        earlier = before.ages_s + max(0, self.at_ns - before.at_ns) / NS
        return replace(self, ages_s=np.where(before.ages_s < LONG_AGO, np.minimum(self.ages_s, earlier), self.ages_s))

    def share_seen(self, than_s: float, now_ns: int) -> float:
        """Return the share of the floor, 0 to 1, that was looked at during the last `than_s`."""
        seen = (self.ages_s < LONG_AGO) & (self.ages_s + (now_ns - self.at_ns) / NS <= than_s)
        return min(1.0, float(np.count_nonzero(seen)) / self.cells)


NOTHING: Final[Mapping[str, ZoneFloor]] = {}


def floor_of(
    zones: Iterable[Zone], looks: FloorLooks, at_ns: int, before: Mapping[str, ZoneFloor] = NOTHING
) -> dict[str, ZoneFloor]:
    """Return the floor of each zone by name, as told at `at_ns`, epoch. before: as it was told earlier."""
    ages = np.frombuffer(looks.ages, "<u2").reshape(looks.rows, looks.columns)
    found = {zone.name: _floor(zone, looks, ages, at_ns) for zone in zones}
    return {name: each.with_earlier(before[name]) if name in before else each for name, each in found.items()}


def _floor(zone: Zone, looks: FloorLooks, ages: NDArray[np.uint16], at_ns: int) -> ZoneFloor:
    """Take the cells whose centres are in the zone; of a zone so narrow that these are too few, those that it touches.

    Cells beyond the grid were never looked at.
    """
    places = (np.array(zone.corners) - looks.origin) / looks.cell_m
    area, size = _area(places), np.array([looks.columns, looks.rows])
    low, high = np.floor(places.min(axis=0)), np.ceil(places.max(axis=0))
    is_whole = float(np.prod(high - low)) <= MOST_CELLS
    if not is_whole:
        low, high = np.clip(low, 0, size), np.clip(high, 0, size)
    first, (columns, rows) = low.astype(int), (high - low).astype(int)
    inside, touched = _cells_of(places - low, columns, rows)
    cells = inside if np.count_nonzero(inside) >= LEAST_COVERED * area else touched
    count = max(1.0, float(np.count_nonzero(cells)))
    x, y = (np.array(looks.origin) + low * looks.cell_m).tolist()
    seen = _part(ages, first, columns, rows)[cells].astype(np.float64)
    return ZoneFloor(at_ns, seen, count if is_whole else max(area, count), (x, y), looks.cell_m)


def _part(ages: NDArray[np.uint16], first: NDArray[np.int_], columns: int, rows: int) -> NDArray[np.uint16]:
    """Return a part of a grid that begins at its cell `first` (x, y), and may reach beyond it."""
    part = np.full((rows, columns), LONG_AGO, np.uint16)
    low = np.clip(first, 0, ages.shape[::-1])
    high = np.clip(first + np.array([columns, rows]), 0, ages.shape[::-1])
    (x, y), (end_x, end_y) = low - first, high - first
    part[y:end_y, x:end_x] = ages[low[1] : high[1], low[0] : high[0]]
    return part


def _cells_of(places: NDArray[np.float64], columns: int, rows: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return of which of some cells the centre is in a polygon, and which ones it touches. places: in cells."""
    x, y = np.arange(columns) + 0.5, np.arange(rows)[:, np.newaxis] + 0.5
    inside, crossed = (np.zeros((rows, columns), np.bool_) for _ in range(2))
    for (ax, ay), (bx, by) in zip(places, np.roll(places, -1, axis=0), strict=True):
        dx, dy = bx - ax, by - ay
        if dy:
            inside ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * dx / dy)
        near = (abs(2 * x - ax - bx) < abs(dx) + 1) & (abs(2 * y - ay - by) < abs(dy) + 1)
        crossed |= near & (2 * abs((x - ax) * dy - (y - ay) * dx) < abs(dx) + abs(dy))
    return inside, inside | crossed


def _area(corners: NDArray[np.float64]) -> float:
    x, y = corners.T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2
