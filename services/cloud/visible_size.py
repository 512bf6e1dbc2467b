"""Computes the size and centre of an object from its visible mask, not from readings alone.

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
from services.cloud.surfaces import Faces, fit_faces
from services.cloud.upright_boxes import Boxes, Level, fit

Numbers = NDArray[Any]

PIXELS: Final = 128
"""Pixels sampled, at most, for the extent of its faces, and as many for the centre of the part without readings."""

NEAR: Final = 4
"""Edge pixels this far from a reading are ignored: they may belong to a face without any."""

STRAY: Final = 0.03
"""Share of the pixels at its edge that may lie beyond a side of its box."""

STRAY_PIXELS: Final = 1.0
"""Error of a mask's edge, in pixels: the smallest box that explains the mask within it is the object's."""

EXACT_M: Final = 0.007
"""Readings with less noise determine the object's size by themselves."""

MOST_NOISE: Final = 0.002
"""Noise of inverse depth, per metre; beyond it, the shape is not a box."""

BEYOND: Final = 0.25
"""Pixels without a reading are at most this share of an object's width behind those with one."""

ASIDE: Final = 0.95
"""Minimum distance of its faces, relative to the nearest readings."""

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
    """Return the pixels of the mask without a reading, and its edge pixels that are near a reading."""
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
    """Return ones, columns and rows of a sample of each object's chosen pixels, (n, 3, PIXELS); of none the first."""
    counts = np.array([len(at) for at in chosen])
    flat = np.zeros((len(chosen), PIXELS), np.intp)
    flat[counts > 0] = np.concatenate(chosen).take(spread(counts[counts > 0], PIXELS))
    rows, columns = np.divmod(flat, np.array([[seen.mask.pixels.shape[1]] for seen in objects]))
    return np.stack([np.ones_like(flat), columns, rows], axis=1)


def _placed(pixels: NDArray[np.intp], faces: Faces, cells: Cells, off: float = 0.0) -> Numbers:
    """Return the positions of pixels (n, 3, m) on their objects' faces: (n, 3, m), along the level axes.

    off: they may be off by so many pixels, and those that then are on a nearer face are on that.
    """
    aimed = cells.places @ pixels
    wide = np.ptp(aimed, axis=2).max(axis=1)
    far, _, near = cells.depths[:, :, np.newaxis]
    far = far * (1 + BEYOND * wide[:, np.newaxis])
    nearer = off * np.abs(faces.forms @ cells.places[:, :, 1:]).sum(axis=2, keepdims=True)
    return np.asarray(aimed / np.clip(faces.inverse_depth(aimed, nearer), 1 / far, 1 / (ASIDE * near))[:, np.newaxis])


def _extents(edges: NDArray[np.intp], faces: Faces, cells: Cells) -> tuple[Numbers, Numbers]:
    """Return the extent of objects along their sides, minimum and maximum (n, 3).

    edges: pixels (n, 3, m). Faces seen almost edge-on extend as far as necessary.
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
    """Return the centres (n, 3) of readings and this many pixels without one, whose own centres are `added`."""
    totals = np.array([seen.xyz.sum(axis=1) for seen in objects], np.float64)
    counts = np.array([(len(seen.at), lost) for seen, lost in zip(objects, unread, strict=True)])
    return np.asarray((totals + added * counts[:, 1:]) / counts.sum(axis=1, keepdims=True))
