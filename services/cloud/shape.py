"""Where an object is, and the smallest upright box around it. Pure."""

import math
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from services.cloud.points import Floats
from services.cloud.sampling import some

Reals = NDArray[np.float64]

TURNS: Final = 24
"""Directions that are tried, over a quarter of a turn."""

FINE: Final = 11
"""Directions that are tried around the best of them."""

ALIKE: Final = 1.1
"""Rectangles of up to so many times the smallest area count as small."""

_FINER: Final = np.linspace(-1, 1, FINE)

MIN_AREA_M2: Final = 1e-9
UPRIGHT: Final = 0.9

SAMPLES: Final = 2048
"""So many points at most say how large an object is."""

TURNED: Final = 256
"""So many of them at most say how it is turned."""

TRIM: Final = 0.005
"""Share of the points that may lie beyond a side of the box: its size is not that of the noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """What is upright in a frame of reference: unit vectors. x: the frame's own, made level; y: left of it."""

    x: Reals
    y: Reals
    up: Reals

    @classmethod
    def of(cls, up: Reals) -> Self:
        """Return the level axes; where the frame's x axis is upright itself its z axis is taken instead."""
        first = np.eye(3)[0 if abs(up[0]) < UPRIGHT else 2]
        x = first - up * (up @ first)
        x /= np.linalg.norm(x)
        (a, b, c), (d, e, f) = up.tolist(), x.tolist()
        return cls(x, np.array([b * f - c * e, c * d - a * f, a * e - b * d]), up)

    def yaw(self, along: Reals) -> float:
        """Return the angle from x to a level line, counter-clockwise seen from above, above -pi / 2 to pi / 2.

        A line has two ways to go, and this is the smaller angle.
        """
        angle = math.atan2(along @ self.y, along @ self.x)
        return angle - math.pi * round(angle / math.pi)


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """An upright box. size: length, width, height. along: unit vector of its length, level."""

    centre: Reals
    size: Reals
    along: Reals


def fit_box(xyz: Floats, level: Level) -> Box:
    """Return the smallest upright box around (3, n) points; see `_best`."""
    axes = np.array([level.x, level.y, level.up])
    flat = axes.astype(np.float32) @ xyz.take(some(xyz.shape[1], SAMPLES), axis=1)
    turned = _turned(_angle(flat[:2].take(some(flat.shape[1], TURNED), axis=1)))
    low, high = _extent(turned.astype(np.float32) @ flat)
    return _between(low, high, turned @ axes)


def box_between(low: Reals, high: Reals, level: Level, angle: float) -> Box:
    """Return the upright box from the lowest to the highest places along its sides.

    angle: of the first side, counter-clockwise, to level's x; the second one is left of it, the third one up.
    """
    return _between(low, high, _turned(angle) @ np.array([level.x, level.y, level.up]))


def _turned(angle: float) -> Reals:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])


def _between(low: Reals, high: Reals, sides: Reals) -> Box:
    size = high - low
    centre = ((low + high) / 2) @ sides
    if size[0] < size[1]:
        return Box(centre, size[[1, 0, 2]], sides[1])
    return Box(centre, size, sides[0])


def _extent(points: Floats) -> tuple[Reals, Reals]:
    """Return the lowest and highest value of each row, less what is beyond TRIM."""
    last = points.shape[1] - 1
    beyond = int(last * TRIM)
    ordered = np.sort(points, axis=1)
    return ordered[:, beyond].astype(np.float64), ordered[:, last - beyond].astype(np.float64)


def _angle(points: Floats) -> float:
    step = np.pi / 2 / TURNS
    coarse = _best(points, np.arange(TURNS) * step)
    return _best(points, coarse + step * _FINER)


def _best(points: Floats, angles: NDArray[np.floating]) -> float:
    """Return the angle of the rectangle around (2, n) points to whose sides they are nearest, of the small ones.

    Several rectangles around the two sides of a box that are seen, an L, are as small as each other.
    """
    cos, sin = np.cos(angles).astype(np.float32), np.sin(angles).astype(np.float32)
    reach = np.array([[cos, sin], [-sin, cos]]).transpose(0, 2, 1) @ points
    low, high = reach.min(axis=2), reach.max(axis=2)
    area = np.prod(high - low, axis=0)
    small = np.flatnonzero(area <= ALIKE * area.min() + MIN_AREA_M2)
    inside = reach[:, small]
    off = np.minimum(inside - low[:, small, None], high[:, small, None] - inside).min(axis=0)
    return float(angles[small[off.sum(axis=1).argmin()]])
