"""Whether objects that views do not show are hidden, out of view, looked past, or there but missed. Pure."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.worldmodel.frames import Frames
from services.worldmodel.objects import CELL_M, Index, Objects
from services.worldmodel.placement import NOISE_PER_M2

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]

NEAREST_M: Final = 0.6
FARTHEST_M: Final = 9.0
"""Depth beyond is too coarse to say that something is gone."""

MARGIN_M: Final = 0.12
MARGIN_SIGMAS: Final = 3.0
"""Depth must be behind an object's near side by so much, and by so many of its standard deviations, to be past it."""

INSIDE: Final = 0.6
"""Share of an object's probed points that must be in view, and unhidden, for a miss to count."""

MIN_PASSED_SHARE: Final = 0.75
"""Share of the points in view that must be looked past."""

BACKGROUND_MARGINS: Final = 1.2
"""By so many margins what an object stands on must be behind a probed point for the point to tell anything."""

FEWEST: Final = 2
"""Probed points, at least, that must tell that a view looks past an object."""

LEVEL_M: Final = 0.05
"""Above a point by less than this, a camera sees past it as far as it can."""

ASIDE: Final = 0.6
LEVELS: Final = (0.35, 0.75, 0.95)
"""Where on its near side an object is probed: in the middle and so far aside, at these shares of its height.

The background behind the upper edge of low objects is the farthest, so that level tells the most about them. As it may
miss an object, an object is in plain view where the levels below it are.
"""

PROBES: Final = 3 * len(LEVELS)
PLAIN: Final = PROBES - 3
"""Those below the upper edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """Objects that views should show. frame: of the view. rows: of the object. past: the view looks past its place.

    distance: along the optical axis, metres.
    """

    frame: Rows
    rows: Rows
    past: NDArray[np.bool_]
    distance: Floats

    def taken(self, which: Rows | NDArray[np.bool_]) -> "Looks":
        """Return some of them."""
        return Looks(self.frame[which], self.rows[which], self.past[which], self.distance[which])

    def not_past(self, which: NDArray[np.bool_]) -> "Looks":
        """Return them, some of which do not say that the place is empty."""
        return Looks(self.frame, self.rows, self.past & ~which, self.distance)


def look(frames: Frames, camera: Floats, rotation: Floats, objects: Objects, index: Index) -> Looks:
    """Tell which objects are in plain view of cameras, and which of these they look past.

    camera, rotation: of each view's optical frame in the map.
    """
    frame, near = _ahead(frames, camera, rotation, objects, index)
    points = _probes(objects, near, camera[frame], rotation[frame])
    depth = points[..., 2]
    fx, fy, cx, cy = (each[:, np.newaxis] for each in frames.lens[frame].T)
    columns, rows = frames.columns[frame][:, np.newaxis], frames.rows[frame][:, np.newaxis]
    safe = np.maximum(depth, 0.05)
    column, row = fx * points[..., 0] / safe + cx, fy * points[..., 1] / safe + cy
    inside = (depth > NEAREST_M) & (column >= 0.5) & (column < columns - 0.5) & (row >= 0.5) & (row < rows - 0.5)
    cell = frames.starts[frame][:, np.newaxis] + np.where(inside, row, 0).astype(np.intp) * columns
    cell += np.where(inside, column, 0).astype(np.intp)
    near_m, far_m = frames.near_mm.take(cell) / 1000.0, frames.far_mm.take(cell) / 1000.0
    margin = MARGIN_M + MARGIN_SIGMAS * NOISE_PER_M2 * depth * depth
    plain = inside & (near_m > 0) & (far_m >= depth - margin)
    telling = plain & (_behind(objects, near, camera[frame], depth) > depth + BACKGROUND_MARGINS * margin)
    past = telling & (near_m > depth + margin)
    count, distance = plain[:, :PLAIN].sum(axis=1), depth.mean(axis=1)
    kept = np.flatnonzero((count >= INSIDE * PLAIN) & (distance < FARTHEST_M) & (distance > NEAREST_M))
    least = np.maximum(MIN_PASSED_SHARE * telling.sum(axis=1)[kept], FEWEST)
    return Looks(frame[kept], near[kept], past.sum(axis=1)[kept] >= least, distance[kept])


def _ahead(frames: Frames, camera: Floats, rotation: Floats, objects: Objects, index: Index) -> tuple[Rows, Rows]:
    """Return pairs of views and objects in the sector that a view looks into."""
    ahead = rotation[:, :2, 2] / np.maximum(np.hypot(*rotation[:, :2, 2].T), 1e-6)[:, np.newaxis]
    middle = camera[:, :2] + ahead * (FARTHEST_M / 2)
    reach = FARTHEST_M / 2 + CELL_M / 2
    frame, rows = index.within(middle - reach, middle + reach)
    away = objects.centre[rows] - camera[frame, :2]
    forward = np.einsum("nk,nk->n", away, ahead[frame])
    side = np.abs(away[:, 1] * ahead[frame, 0] - away[:, 0] * ahead[frame, 1])
    wide = frames.columns / (2 * frames.lens[:, 0]) + 0.1
    kept = (forward > 0) & (side < wide[frame] * forward + 0.5) & (forward < FARTHEST_M + 1)
    return frame[kept], rows[kept]


def _levels(objects: Objects, near: Rows) -> Floats:
    """Return the heights at which objects are probed, (n, LEVELS)."""
    low, tall = objects.low[near], objects.high[near] - objects.low[near]
    return np.stack([low + share * tall for share in LEVELS], axis=1)


def _behind(objects: Objects, near: Rows, camera: Floats, depth: Floats) -> Floats:
    """Return how far one sees at least past probes (n, PROBES): to what an object stands on, if nothing is nearer."""
    above = camera[:, 2:] - np.repeat(_levels(objects, near), PROBES // len(LEVELS), axis=1)
    down = camera[:, 2:] - objects.low[near][:, np.newaxis]
    return np.where(above > LEVEL_M, depth * down / np.maximum(above, LEVEL_M), np.inf)


def _probes(objects: Objects, near: Rows, camera: Floats, rotation: Floats) -> Floats:
    """Return PROBES points on each object's near side in the optical frame (n, PROBES, 3)."""
    centre, half = objects.centre[near], objects.size[near].min(axis=1) / 2
    away = centre - camera[:, :2]
    along = away / np.maximum(np.hypot(*away.T), 1e-6)[:, np.newaxis]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    front = centre - along * half[:, np.newaxis]
    aside = np.stack([0 * half, ASIDE * half, -ASIDE * half], axis=1)
    points = np.empty((len(near), len(LEVELS), 3, 3))
    points[..., :2] = (front[:, np.newaxis] + across[:, np.newaxis] * aside[..., np.newaxis])[:, np.newaxis]
    points[..., 2] = _levels(objects, near)[:, :, np.newaxis]
    return np.asarray((points.reshape(len(near), PROBES, 3) - camera[:, np.newaxis]) @ rotation)
