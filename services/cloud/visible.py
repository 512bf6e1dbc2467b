"""How large an object is, and where its middle is, by what a camera's picture shows of it and not by readings alone.

Readings are lost at edges and on faces seen from aside, and noise makes objects deeper than they are: the faces that
readings are of say where those pixels of the mask are that have none. Pure.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.cloud.outlines import Masked
from services.cloud.points import Floats, Indices
from services.cloud.sampling import some
from services.cloud.shape import Box, Level, box_between, fit_box
from services.cloud.surfaces import Faces, fit_faces, _least
from services.geometry.masks import Window

Numbers = NDArray[Any]

READINGS: Final = 1024
"""Of an object's readings so many at most say what its faces are."""

CELLS: Final = 128
"""In so many cells of its picture at most, of each of which the mean counts."""

PIXELS: Final = 256
"""So many pixels at most say how far its faces go, and as many where the middle is of what has no reading."""

EXACT_M: Final = 0.01
"""Readings of less noise say themselves how large an object is."""

BEYOND: Final = 0.5
"""What has no reading is at most so much of an object's width behind what has one."""

NEAR_PX = 4
TOL = 2.0
SHARES: Final = (0.02, 0.5, 0.98)
"""Of its readings: which ones are the farthest, in the middle and the nearest."""

ASIDE: Final = 0.95
"""How near, of the nearest of them, its faces may come."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """An object and its readings. at: flat places of these in the object's window, ascending. xyz: (3, n) these."""

    masked: Masked
    at: Indices
    xyz: Floats

    @property
    def mask(self) -> Window:
        """The object in the picture."""
        return self.masked.mask

    @property
    def inner(self) -> Window:
        """What is trusted of it, in the same window."""
        return self.masked.inner


def shapes(objects: Sequence[Seen], level: Level) -> list[tuple[Numbers, Box]]:
    """Return centroid and box of each object; they are seen from the origin, along z."""
    if not objects:
        return []
    cells = _cells(objects, np.array([level.x, level.y, level.up]))
    faces = fit_faces(cells.directions, cells.inverse, cells.weights)
    unread = [_unread(seen) for seen in objects]
    snug, placed = _placed(np.stack([_picked(*each) for each in zip(objects, unread, strict=True)]), faces, cells)
    low, high = _extents(snug[:, :, PIXELS:] if NEAR_PX else snug, faces.along)
    exact = _is_exact(cells, faces)
    made = []
    for number, (seen, without) in enumerate(zip(objects, unread, strict=True)):
        centroid = _middle(seen, placed[number], len(without), level)
        if exact[number]:
            made.append((centroid, fit_box(seen.xyz, level)))
        else:
            made.append((centroid, box_between(low[number], high[number], level, float(faces.along[number]))))
    return made


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Means of n objects' readings. directions: (3, n, CELLS), level. inverse, weights: (n, CELLS).

    places: (n, 3, 3), how directions follow from (1, column, row) in the window.
    """

    directions: Numbers
    inverse: Numbers
    weights: Numbers
    places: Numbers

    @property
    def depths(self) -> Numbers:
        """Near, middle and far depths of each object's readings, (3, n)."""
        ordered = np.sort(np.where(self.weights > 0, self.inverse, np.inf), axis=1)
        last = (self.weights > 0).sum(axis=1) - 1
        rows = np.arange(len(ordered))
        return np.stack([1 / ordered[rows, (last * share).astype(np.intp)] for share in SHARES])


def _cells(objects: Sequence[Seen], axes: Numbers) -> _Cells:
    kept = [some(len(seen.at), READINGS) for seen in objects]
    at = np.concatenate([seen.at[chosen] for seen, chosen in zip(objects, kept, strict=True)])
    xyz = np.concatenate([seen.xyz.take(chosen, axis=1) for seen, chosen in zip(objects, kept, strict=True)], axis=1)
    counts = [len(each) for each in kept]
    sizes = np.array([(seen.mask.pixels.shape[1], *_side(*seen.mask.pixels.shape)) for seen in objects])
    width, side, across = np.repeat(sizes, counts, axis=0).T
    rows, columns = np.divmod(at, width)
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
    return _Cells(directions, means[3], weights, _places(directions, means[4], means[5], weights))


def _side(height: int, width: int) -> tuple[int, int]:
    """Return the side of square cells of which at most CELLS cover a window, and how many there are in a row."""
    side = max(2, int(np.sqrt(height * width / CELLS)))
    while -(-height // side) * -(-width // side) > CELLS:
        side += 1
    return side, -(-width // side)


def _places(directions: Numbers, columns: Numbers, rows: Numbers, weights: Numbers) -> Numbers:
    """Return how directions follow from pixels (n, 3, 3): within an object any lens is straight enough."""
    share = weights / weights.sum(axis=1, keepdims=True)
    pixels = np.stack([columns, rows])
    middle = np.einsum("nm,pnm->np", share, pixels)
    apart = (pixels - middle.T[:, :, None]) * (weights > 0)
    aimed = np.einsum("nm,cnm->nc", share, directions)
    spread = np.einsum("nm,pnm,qnm->npq", share, apart, apart)
    slope = np.einsum("nm,cnm,pnm->ncp", share, directions - aimed.T[:, :, None], apart) @ np.linalg.pinv(spread)
    return np.concatenate([(aimed - np.einsum("ncp,np->nc", slope, middle))[:, :, None], slope], axis=2)


def _unread(seen: Seen) -> Indices:
    """Return the pixels of the mask that have no reading."""
    if len(seen.at) == seen.mask.area:
        return np.zeros(0, np.intp)
    without = seen.mask.pixels.copy()
    without.reshape(-1)[seen.at] = False
    return np.flatnonzero(without)


def _picked(seen: Seen, unread: Indices) -> NDArray[np.intp]:
    """Return ones, columns and rows (3, 2 * PIXELS): of some pixels without readings, then of some of the edge.

    The last one is repeated.
    """
    edge = np.flatnonzero(_outline(seen))
    if not len(edge):
        edge = np.flatnonzero(seen.mask.pixels)
    flat = np.full(2 * PIXELS, edge[-1])
    without, outline = unread[some(len(unread), PIXELS)], edge[some(len(edge), PIXELS)]
    flat[: len(without)] = without
    flat[PIXELS : PIXELS + len(outline)] = outline
    rows = flat // seen.mask.pixels.shape[1]
    return np.stack([np.ones_like(flat), flat - rows * seen.mask.pixels.shape[1], rows])


def _outline(seen: Seen) -> NDArray[np.bool_]:
    import cv2
    edge = seen.mask.pixels > seen.inner.pixels
    if NEAR_PX <= 0: return edge
    read = np.zeros(edge.size, np.uint8)
    read[seen.at] = 1
    n = 2*NEAR_PX+1
    near = cv2.dilate(read.reshape(edge.shape), np.ones((n,n),np.uint8))
    return edge & (near > 0)


def _placed(pixels: NDArray[np.intp], faces: Faces, cells: _Cells) -> Numbers:
    """Return where on their objects' faces pixels (n, 3, m) are: (n, 3, m), along the level axes."""
    aimed = cells.places @ pixels
    wide = np.ptp(aimed, axis=2).max(axis=1)
    far, _, near = cells.depths[:, :, np.newaxis]
    far = far * (1 + BEYOND * wide[:, np.newaxis])
    values = np.asarray(faces.forms @ aimed)
    slope = np.abs(faces.forms @ cells.places[:, :, 1:]).sum(axis=2)
    out = []
    for t in (TOL, 0):
        w = _least(values + t * slope[:, :, None])
        out.append(aimed / np.clip(w, 1 / far, 1 / (ASIDE * near))[:, np.newaxis])
    snug, exact = out
    snug[:, 2] = exact[:, 2]
    return snug, exact


def _extents(placed: Numbers, along: Numbers) -> tuple[Numbers, Numbers]:
    """Return the least and the greatest places, (n, 3), of points along the sides of the objects that they are of."""
    cos, sin = np.cos(along)[:, np.newaxis], np.sin(along)[:, np.newaxis]
    x, y, up = placed.transpose(1, 0, 2)
    turned = np.stack([cos * x + sin * y, cos * y - sin * x, up], axis=1)
    return turned.min(axis=2), turned.max(axis=2)


def _is_exact(cells: _Cells, faces: Faces) -> NDArray[np.bool_]:
    """Return which objects are so near that their readings have little noise."""
    return np.asarray(np.median(faces.noise) * cells.depths[1] ** 2 < EXACT_M)


def _middle(seen: Seen, placed: Numbers, unread: int, level: Level) -> Numbers:
    """Return the middle of readings and of pixels without one, of which the first of those placed are some."""
    read = len(seen.at)
    mean = seen.xyz.mean(axis=1).astype(np.float64)
    if not unread:
        return np.asarray(mean)
    x, y, up = placed[:, : min(unread, PIXELS)].mean(axis=1)
    return np.asarray((mean * read + (x * level.x + y * level.y + up * level.up) * unread) / (read + unread))
