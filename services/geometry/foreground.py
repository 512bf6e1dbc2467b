"""Selects the readings in a mask that belong to the object: background bleeds in at edges and through gaps."""

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.geometry.masks import Window, surroundings

Depths = NDArray[Any]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]

_NEIGHBOURS: Final = 0.02
"""Share of the readings that lie close together where there is a surface."""

_GAP_M: Final = 0.06
_GAP_SHARE: Final = 0.02
"""How close that is: so many metres, and so much of the depth itself."""

_FOREIGN: Final = 12.0
"""A surface that has a greater share of what is around the mask than of the mask itself is foreign when another one is
so many times as much the mask's own."""

_SUPPORT: Final = 0.2
"""The share of the mask that such another one has at least."""

_FAINT: Final = 0.02
"""A share around the mask that says nothing."""

WELL_READ: Final = 0.9
"""A mask with a reading in a greater share of its pixels counts as one with the object's own: an object without depth
leaves a hole that is larger, unless almost all of its mask is rim."""

_RIM: Final = 3
"""Pixels at a mask's edge, at least, where masks, and depth brought to colour, may be off."""

_RIM_SHARE: Final = 0.5
"""The rim's share of the way from a mask's edge to its innermost pixels: masks are as coarse as a model's prototypes,
which are 4 pixels wide in an image of 640 and 8 in one of 1280, so that no width in pixels fits all images."""

_RING: Final = 5
"""Pixels around a mask that say what the object's surroundings are."""

_CORE_SHARE: Final = 0.3
"""The least that a mask with readings of the object's own is read inside of its rim, of how densely its surroundings
are."""

_REACH: Final = 12
"""Pixels within which a surface that goes on outside of the mask has a reading there."""

_GOES_ON: Final = 0.5
"""The least share of a mask's readings that go on outside of it where all are of the surroundings."""


def foreground(within: Depths, around: Depths) -> Bools:
    """Return which readings of n objects belong to them, n x m.

    within: n x m, readings within each mask, in metres, each row ascending. around: n x k, readings just outside of it,
    each row ascending, NaN where there are fewer.

    Where readings lie dense is a surface. One that is more around the mask than in it is something behind or before the
    object, if there is another one that may be the object; then what is on no surface is left out too.
    """
    dense = _dense(within)
    own = np.ones(within.shape, np.bool_)
    whose, first, last = _surfaces(dense, within.shape[1] - dense.shape[1])
    if not len(whose):
        return own
    kept = _kept(within, whose, first, last, around)
    partly = np.zeros(len(within), np.bool_)
    partly[whose[~kept]] = True
    own[partly] = False
    for row, start, end in zip(*(each[kept & partly[whose]].tolist() for each in (whose, first, last)), strict=True):
        own[row, start : end + 1] = True
    return own


def on_surface(within: Depths) -> Bools:
    """Return which of each row's ascending readings, n x m, are dense; between two surfaces they are sparse."""
    dense = _dense(within)
    starts = np.zeros((len(within), within.shape[1] + 1), np.int32)
    near = within.shape[1] - dense.shape[1]
    starts[:, 1 : dense.shape[1] + 1] = np.cumsum(dense, axis=1)
    starts[:, dense.shape[1] + 1 :] = starts[:, dense.shape[1], np.newaxis]
    before = np.maximum(np.arange(within.shape[1]) - near, 0)
    return np.asarray(starts[:, 1:] > starts[:, before])


def has_own_depth(window: Window, depth_m: Depths) -> bool:
    """Return whether any readings in a mask belong to the object.

    An object that gives no depth, being black, shiny or too near, has readings at its mask's rim all the same: those of
    what is around it, for masks and depth never fit exactly. They lie on the rim alone, and go on outside of it.

    window: a mask with a margin of at least 5 pixels, as far as the image goes. depth_m: metres along the optical axis
    of the window's pixels, height x width; NaN or 0 for no reading.
    """
    if not window.pixels.any():
        return True  # an empty mask has no readings to judge
    read = depth_m > 0
    core_share = read[_core(window)].mean()
    if core_share >= _CORE_SHARE:  # whatever is read around it
        return True
    ring = surroundings(window, _RING)
    outside = read & ring
    if not outside.any() or core_share >= _CORE_SHARE * read[ring].mean():
        return True
    inside = read & window.pixels
    going_on = inside & _is_among(depth_m, outside)
    return bool(going_on.sum() < _GOES_ON * inside.sum())


def _core(window: Window) -> Bools:
    """Return the pixels of a mask inside of its rim, at least the innermost. The end of the image is no rim."""
    depth = cv2.distanceTransform(window.pixels.view(np.uint8), cv2.DIST_C, 3)  # 1 at the edge
    deepest = float(depth.max())
    return np.asarray(depth > max(_RIM_SHARE * deepest, min(_RIM, deepest - 1)))


def _is_among(depth_m: Depths, others: Bools) -> Bools:
    """Return which readings lie between other readings within _REACH, or close to one of them."""
    square = np.ones((2 * _REACH + 1, 2 * _REACH + 1), np.uint8)
    nearest = cv2.erode(np.where(others, depth_m, np.inf).astype(np.float32), square)
    farthest = cv2.dilate(np.where(others, depth_m, 0).astype(np.float32), square)
    slack = _GAP_M + _GAP_SHARE * depth_m
    return np.asarray((depth_m >= nearest - slack) & (depth_m <= farthest + slack))


def _dense(within: Depths) -> Bools:
    """Return where each row has a surface's share of readings close behind a reading; never its last ones."""
    near = max(1, round(within.shape[1] * _NEIGHBOURS))
    starts = within[:, :-near]
    return np.asarray(within[:, near:] - starts <= _GAP_M + _GAP_SHARE * starts)


def _surfaces(dense: Bools, near: int) -> tuple[Indices, Indices, Indices]:
    """Return the row of each surface and its first and last reading, a fixed number after the last dense one."""
    bordered = np.zeros((len(dense), dense.shape[1] + 2), np.bool_)
    bordered[:, 1:-1] = dense
    rows, edges = np.nonzero(bordered[:, 1:] != bordered[:, :-1])
    return rows[::2], edges[::2], edges[1::2] + (near - 1)


def _kept(within: Depths, whose: Indices, first: Indices, last: Indices, around: Depths) -> Bools:
    """Return which surfaces, each from its first to its last reading, belong to the object."""
    inside = (last - first + 1) / within.shape[1]
    nearest, farthest, beside = within[whose, first], within[whose, last], around[whose]
    slack = (_GAP_M + _GAP_SHARE * nearest)[:, np.newaxis]
    met = (beside >= nearest[:, np.newaxis] - slack) & (beside < farthest[:, np.newaxis] + slack)
    outside = met.sum(axis=1) / np.maximum((around > 0).sum(axis=1), 1)[whose]
    owned = inside / (outside + _FAINT)
    most = np.zeros(len(within))
    np.maximum.at(most, whose, np.where(inside >= _SUPPORT, owned, 0))
    return np.asarray((inside >= outside) | (owned * _FOREIGN >= most[whose]))
