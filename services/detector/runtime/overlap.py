"""How well boxes lie on each other where the border of the image may have cut them. Pure.

Boxes are corners in pixels (n x 4: left, top, right, bottom), sizes an image's width and height.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

NEAR: Final = 3.0
"""Pixels from the border within which it may have cut a box."""


def at_border(boxes: Floats, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return which sides (n x 4) lie at the border: what is seen there may be a part of the object alone."""
    return np.concatenate([boxes[:, :2] <= NEAR, boxes[:, 2:] >= np.subtract(size, NEAR)], axis=1)


def overlaps(boxes: Floats, found: Floats, cut: NDArray[np.bool_], size: tuple[int, int]) -> Floats:
    """Return boxes x found: the IoU of what of a box is in the image with what was found.

    cut: the boxes' sides that were at the border. What comes into view there belongs to the box if it was found.
    """
    begins = np.where(cut[:, None, :2], np.minimum(boxes[:, None, :2], found[:, :2]), boxes[:, None, :2])
    ends = np.where(cut[:, None, 2:], np.maximum(boxes[:, None, 2:], found[:, 2:]), boxes[:, None, 2:])
    begins, ends = np.clip(begins, 0, size), np.clip(ends, 0, size)
    both = _areas(np.minimum(ends, found[:, 2:]) - np.maximum(begins, found[:, :2]))
    either = _areas(ends - begins) + _areas(found[:, 2:] - found[:, :2]) - both
    return np.asarray(both / np.maximum(either, np.finfo(np.float64).tiny), np.float64)


def _areas(sides: Floats) -> Floats:
    return np.asarray(np.prod(np.maximum(sides, 0), axis=-1), np.float64)
