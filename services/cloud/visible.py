"""How large an object is, and where its middle is, by what a camera's picture shows of it and not by readings alone.

Readings are lost at edges and on faces seen from aside, and noise makes objects deeper than they are: the faces that
readings are of say where those pixels of the mask are that have none. Pure.
"""

from collections.abc import Sequence
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.cloud.cells import Cells, Seen, cells_of
from services.cloud.points import Indices, spread
from services.cloud.shape import Boxes, Level, fit
from services.cloud.surfaces import Faces, fit_faces

Numbers = NDArray[Any]

PIXELS: Final = 128
"""So many pixels at most say how far its faces go, and as many where the middle is of what has no reading."""

NEAR: Final = 4
"""Pixels at its edge that are so many pixels from a reading say nothing: they may be of a face that none is of."""

STRAY: Final = 0.03
"""Share of the pixels at its edge that may lie beyond a side of its box."""

STRAY_PIXELS: Final = 1.0
"""How far off a mask's edge may be, in pixels: the smallest box that explains it so is the object's."""

EXACT_M: Final = 0.007
"""Readings of less noise say themselves how large an object is."""

MOST_NOISE: Final = 0.002
"""Noise of inverse depth, per metre; more than that is a shape that is no box's."""

BEYOND: Final = 0.25
"""What has no reading is at most so much of an object's width behind what has one."""

ASIDE: Final = 0.95
"""How near, of the nearest of them, its faces may come."""

_AROUND: Final = np.ones((2 * NEAR + 1, 2 * NEAR + 1), np.uint8)


def shapes(objects: Sequence[Seen], level: Level) -> tuple[Numbers, Boxes]:
    """Return the objects' centroids (n, 3) and boxes; they are seen from the origin, along z."""
    axes = np.array([level.x, level.y, level.up])
    cells = cells_of(objects, axes)
    faces = fit_faces(cells.directions, cells.inverse, cells.weights)
    unread, edges = zip(*(_unread_and_edge(seen) for seen in objects), strict=True)
    low, high = _extents(_pixels(objects, edges), faces, cells)
    angles = faces.along.astype(np.float64)
    for number in np.flatnonzero(_is_exact(cells, faces)).tolist():
        low[number], high[number], angles[number] = fit(objects[number].xyz, level)
    added = _placed(_pixels(objects, unread), faces, cells).mean(axis=2) @ axes
    return _middles(objects, added, [len(each) for each in unread]), Boxes.between(low, high, angles, level)


def _unread_and_edge(seen: Seen) -> tuple[Indices, Indices]:
    """Return the pixels of the mask that have no reading, and those at its edge that are near one."""
    window = seen.mask
    across = np.zeros((window.pixels.shape[0], seen.width), np.bool_)
    across.reshape(-1)[seen.at - window.top * seen.width] = True
    read = across[:, window.left : window.left + window.pixels.shape[1]]
    unread = (window.pixels > read).reshape(-1).nonzero()[0]
    edge = window.pixels > seen.inner.pixels
    if len(unread):
        edge &= cv2.dilate(read.view(np.uint8), _AROUND).view(np.bool_)
    found = edge.reshape(-1).nonzero()[0]
    return unread, found if len(found) else np.flatnonzero(read)


def _pixels(objects: Sequence[Seen], chosen: Sequence[Indices]) -> NDArray[np.intp]:
    """Return ones, columns and rows of some of each object's chosen pixels, (n, 3, PIXELS); of none the first pixel."""
    counts = np.array([len(at) for at in chosen])
    flat = np.zeros((len(chosen), PIXELS), np.intp)
    flat[counts > 0] = np.concatenate(chosen).take(spread(counts[counts > 0], PIXELS))
    rows, columns = np.divmod(flat, np.array([[seen.mask.pixels.shape[1]] for seen in objects]))
    return np.stack([np.ones_like(flat), columns, rows], axis=1)


def _placed(pixels: NDArray[np.intp], faces: Faces, cells: Cells, off: float = 0.0) -> Numbers:
    """Return where on their objects' faces pixels (n, 3, m) are: (n, 3, m), along the level axes.

    off: they may be off by so many pixels, and those that then are on a nearer face are on that.
    """
    aimed = cells.places @ pixels
    wide = np.ptp(aimed, axis=2).max(axis=1)
    far, _, near = cells.depths[:, :, np.newaxis]
    far = far * (1 + BEYOND * wide[:, np.newaxis])
    nearer = off * np.abs(faces.forms @ cells.places[:, :, 1:]).sum(axis=2, keepdims=True)
    return np.asarray(aimed / np.clip(faces.inverse_depth(aimed, nearer), 1 / far, 1 / (ASIDE * near))[:, np.newaxis])


def _extents(edges: NDArray[np.intp], faces: Faces, cells: Cells) -> tuple[Numbers, Numbers]:
    """Return how far objects go along their sides, the least and the greatest places, (n, 3).

    edges: pixels (n, 3, m). What is seen nearly from aside goes as far as it must.
    """
    cos, sin = np.cos(faces.along)[:, np.newaxis], np.sin(faces.along)[:, np.newaxis]
    x, y, _ = _placed(edges, faces, cells, STRAY_PIXELS).transpose(1, 0, 2)
    up = _placed(edges, faces, cells)[:, 2]
    ordered = np.sort(np.stack([cos * x + sin * y, cos * y - sin * x, up], axis=1), axis=2)
    beyond = int(STRAY * ordered.shape[2])
    return ordered[:, :, beyond], ordered[:, :, -1 - beyond]


def _is_exact(cells: Cells, faces: Faces) -> NDArray[np.bool_]:
    """Return which objects are so near that their readings have little noise."""
    return np.asarray(np.minimum(faces.noise, MOST_NOISE) * cells.depths[1] ** 2 < EXACT_M)


def _middles(objects: Sequence[Seen], added: Numbers, unread: Sequence[int]) -> Numbers:
    """Return the middles (n, 3) of readings and of so many pixels without one, whose own middles are `added`."""
    totals = np.array([seen.xyz.sum(axis=1) for seen in objects], np.float64)
    counts = np.array([(len(seen.at), lost) for seen, lost in zip(objects, unread, strict=True)])
    return np.asarray((totals + added * counts[:, 1:]) / counts.sum(axis=1, keepdims=True))
