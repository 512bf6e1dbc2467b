"""Averages the readings of objects in cells of the camera's image. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.cloud.outlines import Masked
from services.cloud.points import Floats, Indices, some
from services.geometry.masks import Window

Numbers = NDArray[Any]

READINGS: Final = 512
"""Maximum number of an object's readings that its faces are fitted to."""

CELLS: Final = 128
"""Maximum number of cells of its image, each with the mean of its readings."""

SHARES: Final = (0.02, 0.5, 0.98)
"""Quantiles of its readings: farthest, middle and nearest."""

_THIN: Final = 1e-12
"""Share of the square of its trace that the determinant of what is only a line's spread has at most."""

_TINY: Final = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """An object and its readings in an image of this width in pixels.

    at: flat places of these in the picture, ascending. xyz: (3, n) these.
    """

    masked: Masked
    width: int
    at: Indices
    xyz: Floats

    @property
    def mask(self) -> Window:
        """The object's mask in the image."""
        return self.masked.mask

    @property
    def inner(self) -> Window:
        """The trusted part of the mask, in the same window."""
        return self.masked.inner


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Means of n objects' readings per cell. directions: (3, n, CELLS), level. inverse, weights: (n, CELLS).

    places: (n, 3, 3), how directions follow from (1, column, row) in the window. depths: (3, n), the far, the middle
    and the near ones.
    """

    directions: Numbers
    inverse: Numbers
    weights: Numbers
    places: Numbers
    depths: Numbers


def cells_of(objects: Sequence[Seen], axes: Numbers) -> Cells:
    """Return the means of objects' readings; axes: (3, 3), ahead, left and up, one row each."""
    kept = [some(len(seen.at), READINGS) for seen in objects]
    at = np.concatenate([seen.at[chosen] for seen, chosen in zip(objects, kept, strict=True)])
    xyz = np.concatenate([seen.xyz.take(chosen, axis=1) for seen, chosen in zip(objects, kept, strict=True)], axis=1)
    counts = [len(each) for each in kept]
    sizes = [(seen.width, seen.mask.top, seen.mask.left, *_side(*seen.mask.pixels.shape)) for seen in objects]
    width, top, left, side, across = np.repeat(sizes, counts, axis=0).T
    rows, columns = np.divmod(at, width)
    rows, columns = rows - top, columns - left
    key = rows // side * across + columns // side + np.repeat(np.arange(len(objects)) * CELLS, counts)
    inverse = 1 / xyz[2]
    size = len(objects) * CELLS
    readings = np.bincount(key, minlength=size)
    values = (*(axes.astype(np.float32) @ (xyz * inverse)), inverse, columns, rows)
    means = [(np.bincount(key, each, size) / np.maximum(readings, 1)).reshape(-1, CELLS) for each in values]
    weights = readings.reshape(-1, CELLS) * np.array(
        [[len(seen.at) / len(at)] for seen, at in zip(objects, kept, strict=True)]
    )
    directions = np.stack(means[:3])
    places = _places(directions, means[4], means[5], weights)
    return Cells(directions, means[3], weights, places, _depths(means[3], weights))


def _depths(inverse: Numbers, weights: Numbers) -> Numbers:
    """Return the depths at the quantiles SHARES of each object's readings, (3, n)."""
    ordered = np.sort(np.where(weights > 0, inverse, np.inf), axis=1)
    last = (weights > 0).sum(axis=1) - 1
    rows = np.arange(len(ordered))
    return np.stack([1 / ordered[rows, (last * share).astype(np.intp)] for share in SHARES])


def _side(height: int, width: int) -> tuple[int, int]:
    """Return the side of square cells of which at most CELLS cover a window, and the number of cells per row."""
    side = max(2, int(np.sqrt(height * width / CELLS)))
    while -(-height // side) * -(-width // side) > CELLS:
        side += 1
    return side, -(-width // side)


def _places(directions: Numbers, columns: Numbers, rows: Numbers, weights: Numbers) -> Numbers:
    """Return the linear maps from pixels to directions (n, 3, 3): within an object every lens is nearly linear."""
    share = weights / weights.sum(axis=1, keepdims=True)
    pixels, aimed = np.stack([columns, rows], axis=1), directions.transpose(1, 0, 2)
    middle, mean = pixels @ share[:, :, None], aimed @ share[:, :, None]
    apart = pixels - middle
    weighted = (apart * share[:, None]).transpose(0, 2, 1)
    slope = (aimed - mean) @ weighted @ _inverted(apart @ weighted)
    return np.concatenate([mean - slope @ middle, slope], axis=2)


def _inverted(matrices: Numbers) -> Numbers:
    """Return the pseudoinverses of symmetric positive semidefinite matrices (n, 2, 2)."""
    xx, xy, yy = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]
    trace, det = xx + yy, xx * yy - xy * xy
    thin = det <= _THIN * trace * trace
    adjugate = np.stack([yy, -xy, -xy, xx], axis=1).reshape(-1, 2, 2)
    by = np.where(thin, np.maximum(trace, _TINY) ** 2, det)[:, None, None]
    return np.asarray(np.where(thin[:, None, None], matrices, adjugate) / by)
