"""When the floor of zones was looked at. Pure."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.world import FloorLooks
from services.monitor.world.zones import Zone

NS: Final = 1_000_000_000
LONG_AGO: Final = 65_535
"""Age in seconds of what was looked at longer ago or never."""


@dataclass(frozen=True, slots=True)
class ZoneFloor:
    """The floor of a zone. ages_s: of the last look at each cell that may have been seen. cells: how many it has."""

    at_ns: int
    ages_s: NDArray[np.uint16]
    cells: float

    def share_seen(self, than_s: float, now_ns: int) -> float:
        """Return the share of the floor, 0 to 1, that was looked at during the last `than_s`."""
        seen = (self.ages_s < LONG_AGO) & (self.ages_s + (now_ns - self.at_ns) / NS <= than_s)
        return min(1.0, float(np.count_nonzero(seen)) / self.cells)


def floor_of(zones: Iterable[Zone], looks: FloorLooks, at_ns: int) -> dict[str, ZoneFloor]:
    """Return the floor of each zone by name, as told at `at_ns`, epoch."""
    ages = np.frombuffer(looks.ages, "<u2").reshape(looks.rows, looks.columns)
    return {zone.name: _floor(zone, looks, ages, at_ns) for zone in zones}


def _floor(zone: Zone, looks: FloorLooks, ages: NDArray[np.uint16], at_ns: int) -> ZoneFloor:
    """Take the cells whose centres are in the zone; of a zone smaller than a cell, the cell of its first corner."""
    places = (np.array(zone.corners) - looks.origin) / looks.cell_m
    cells = _area(places)
    if cells < 1:
        column, row = (math.floor(each) for each in places[0])
        there = 0 <= column < looks.columns and 0 <= row < looks.rows
        return ZoneFloor(at_ns, ages[row, column : column + 1] if there else ages[:0, 0:0].ravel(), 1)
    size = np.array([looks.columns, looks.rows])
    low = np.clip(np.floor(places.min(axis=0)), 0, size).astype(int)
    high = np.clip(np.ceil(places.max(axis=0)), 0, size).astype(int)
    x, y = np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1])[:, np.newaxis] + 0.5
    inside = np.zeros((high[1] - low[1], high[0] - low[0]), np.bool_)
    for (ax, ay), (bx, by) in zip(places, np.roll(places, -1, axis=0), strict=True):
        if ay != by:
            inside ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * (bx - ax) / (by - ay))
    return ZoneFloor(at_ns, ages[low[1] : high[1], low[0] : high[0]][inside], cells)


def _area(corners: NDArray[np.float64]) -> float:
    x, y = corners.T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2
