"""Where an object is, and the smallest upright box around it. Pure."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.cloud.points import Floats

Reals = NDArray[np.float64]

TURNS: Final = 24
"""Directions that are tried, over a quarter of a turn."""

FINE: Final = 11
"""Directions that are tried around the best of them."""

ALIKE: Final = 1.1
"""Rectangles of up to so many times the smallest area count as small."""

MIN_AREA_M2: Final = 1e-9
SAMPLES: Final = 256
TRIM: Final = 0.005
"""Share of the points that may lie beyond a side of the box: its size is not that of the noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """An upright box. size: length, width, height. along: unit vector of its length, level; up: of its height."""

    centre: Reals
    size: Reals
    along: Reals
    up: Reals


def level_axes(up: Reals) -> tuple[Reals, Reals]:
    """Return the frame's x axis (or, where that is upright, its z axis) made level, and the level axis left of it."""
    first = np.eye(3)[0 if abs(up[0]) < 0.9 else 2]
    x = first - up * (up @ first)
    x /= np.linalg.norm(x)
    return x, np.cross(up, x)


def yaw_of(along: Reals, up: Reals) -> float:
    """Return the angle about `up` from the frame's x axis, made level, to a level direction: -pi to pi."""
    x, y = level_axes(up)
    return float(np.arctan2(along @ y, along @ x))


def fit_box(xyz: Floats, up: Reals) -> Box:
    """Return the smallest upright box around (3, n) points; see `_best`."""
    x, y = level_axes(up)
    axes = np.stack([x, y, up], axis=1)
    flat = axes.T.astype(np.float32) @ xyz
    angle = _angle(np.ascontiguousarray(flat[:2, :: max(1, flat.shape[1] // SAMPLES)]))
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    low, high = _extent(turn.T.astype(np.float32) @ flat)
    size, along, across = high - low, axes @ turn[:, 0], axes @ turn[:, 1]
    centre = axes @ turn @ ((low + high) / 2)
    if size[0] < size[1]:
        size, along = size[[1, 0, 2]], across
    return Box(centre, size, along, up)


def _extent(points: Floats) -> tuple[Reals, Reals]:
    """Return the lowest and highest value of each row, less what is beyond TRIM."""
    last = points.shape[1] - 1
    beyond = int(last * TRIM)
    ordered = np.partition(points, (beyond, last - beyond), axis=1)
    return ordered[:, beyond].astype(np.float64), ordered[:, last - beyond].astype(np.float64)


def _angle(points: Floats) -> float:
    step = np.pi / 2 / TURNS
    coarse = _best(points, np.arange(TURNS) * step)
    return _best(points, coarse + np.linspace(-step, step, FINE))


def _best(points: Floats, angles: Reals) -> float:
    """Return the angle of the rectangle around (2, n) points to whose sides they are nearest, of the small ones.

    Several rectangles around the two sides of a box that are seen, an L, are as small as each other.
    """
    cos, sin = np.cos(angles).astype(np.float32), np.sin(angles).astype(np.float32)
    reach = np.stack([cos, sin, -sin, cos]).reshape(2, 2, -1).transpose(0, 2, 1) @ points
    low, high = reach.min(axis=2), reach.max(axis=2)
    area = np.prod(high - low, axis=0)
    small = np.flatnonzero(area <= ALIKE * area.min() + MIN_AREA_M2)
    if len(small) == 1:
        return float(angles[small[0]])
    off = [np.minimum(reach[:, at] - low[:, at, None], high[:, at, None] - reach[:, at]).min(axis=0) for at in small]
    return float(angles[small[np.argmin([each.mean() for each in off])]])
