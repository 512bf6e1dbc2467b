"""Computes the smallest upright boxes around objects. Pure."""

import math
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from services.cloud.points import Floats, some
from services.geometry.boxes import level_of

Reals = NDArray[np.float64]

TURNS: Final = 24
"""Number of directions tried over a quarter turn."""

FINE: Final = 11
"""Number of directions tried around the best of them."""

ALIKE: Final = 1.1
"""Rectangles up to this many times the smallest area count as small."""

_FINER: Final = np.linspace(-1, 1, FINE)

MIN_AREA_M2: Final = 1e-9

SAMPLES: Final = 2048
"""Maximum number of points from which an object's size is computed."""

TURNED: Final = 256
"""Maximum number of them from which its orientation is computed."""

TRIM: Final = 0.005
"""Share of the points that may lie beyond a side of the box, so that noise does not enlarge it."""


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """The level axes and up direction of a frame of reference: unit vectors. x: its own, levelled; y: left of it."""

    x: Reals
    y: Reals
    up: Reals

    @classmethod
    def of(cls, up: Reals) -> Self:
        """Return the level axes; if the frame's x axis is upright, its z axis is used instead."""
        x = level_of(up)
        (a, b, c), (d, e, f) = up.tolist(), x.tolist()
        return cls(x, np.array([b * f - c * e, c * d - a * f, a * e - b * d]), up)

    def yaws(self, along: Reals) -> Reals:
        """Return the angles (n,) from x to level lines (n, 3), counter-clockwise seen from above, -pi / 2 to pi / 2.

        A line has two ways to go, and this is the smaller angle.
        """
        angles = np.arctan2(along @ self.y, along @ self.x)
        return np.asarray(angles - np.pi * np.round(angles / np.pi))


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Upright boxes, (n, 3) each. sizes: length, width, height. along: unit vectors of their lengths, level."""

    centres: Reals
    sizes: Reals
    along: Reals

    @classmethod
    def between(cls, low: Reals, high: Reals, angles: Reals, level: Level) -> Self:
        """Return the boxes from the lowest to the highest places (n, 3) along their sides.

        angles: (n,) of the first sides, counter-clockwise, to level's x; the second is left of it, the third one up.
        """
        cos, sin = np.cos(angles)[:, np.newaxis], np.sin(angles)[:, np.newaxis]
        first, second = cos * level.x + sin * level.y, cos * level.y - sin * level.x
        middle, sizes = (low + high) / 2, high - low
        centres = middle[:, :1] * first + middle[:, 1:2] * second + middle[:, 2:] * level.up
        turned = sizes[:, :1] < sizes[:, 1:2]
        return cls(centres, np.where(turned, sizes[:, [1, 0, 2]], sizes), np.where(turned, second, first))


def fit(xyz: Floats, level: Level) -> tuple[Reals, Reals, float]:
    """Return the smallest upright box around (3, n) points as `Boxes.between` takes it; see `_best`."""
    axes = np.array([level.x, level.y, level.up], np.float32)
    flat = axes @ xyz.take(some(xyz.shape[1], SAMPLES), axis=1)
    angle = _angle(flat[:2].take(some(flat.shape[1], TURNED), axis=1))
    return *_extent(_turned(angle) @ flat), angle


def _turned(angle: float) -> Floats:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]], np.float32)


def _extent(points: Floats) -> tuple[Reals, Reals]:
    """Return the minimum and maximum of each row, without the share TRIM beyond them."""
    last = points.shape[1] - 1
    beyond = int(last * TRIM)
    ordered = np.sort(points, axis=1)
    return ordered[:, beyond].astype(np.float64), ordered[:, last - beyond].astype(np.float64)


def _angle(points: Floats) -> float:
    step = np.pi / 2 / TURNS
    coarse = _best(points, np.arange(TURNS) * step)
    return _best(points, coarse + step * _FINER)


def _best(points: Floats, angles: NDArray[np.floating]) -> float:
    """Return the angle of the rectangle around (2, n) points that fits their edges best, of the small ones.

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
