"""Computes the overlap of boxes, also where the image border may cut them. Pure.

Boxes are corners in pixels (n x 4: left, top, right, bottom), sizes an image's width and height.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection

Floats = NDArray[np.float64]

NEAR: Final = 3.0
"""Pixels from the border within which it may have cut a box."""


def boxes_of(objects: Sequence[Detection]) -> Floats:
    """Return the boxes of objects."""
    boxes = (each.box for each in objects)
    return np.array([(box.x1, box.y1, box.x2, box.y2) for box in boxes], np.float64).reshape(-1, 4)


def ious(boxes: Floats, others: Floats) -> Floats:
    """Return the IoU of boxes x others; 0 where the union is empty."""
    return _ious(boxes[:, None, :2], boxes[:, None, 2:], others)


def at_border(boxes: Floats, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return which sides (n x 4) lie at the border, where the object may be cut off."""
    return np.concatenate([boxes[:, :2] <= NEAR, boxes[:, 2:] >= np.subtract(size, NEAR)], axis=1)


def overlaps(boxes: Floats, found: Floats, cut: NDArray[np.bool_], size: tuple[int, int]) -> Floats:
    """Return boxes x found: the IoU of the visible part of each box with each found box.

    cut: the boxes' sides that were at the border. What comes into view there belongs to the box if it was found.
    """
    begins = np.where(cut[:, None, :2], np.minimum(boxes[:, None, :2], found[:, :2]), boxes[:, None, :2])
    ends = np.where(cut[:, None, 2:], np.maximum(boxes[:, None, 2:], found[:, 2:]), boxes[:, None, 2:])
    return _ious(np.clip(begins, 0, size), np.clip(ends, 0, size), found)


def _ious(begins: Floats, ends: Floats, others: Floats) -> Floats:
    both = _areas(np.minimum(ends, others[:, 2:]) - np.maximum(begins, others[:, :2]))
    either = _areas(ends - begins) + _areas(others[:, 2:] - others[:, :2]) - both
    return np.asarray(both / np.maximum(either, np.finfo(np.float64).tiny), np.float64)


def _areas(sides: Floats) -> Floats:
    return np.asarray(np.prod(np.maximum(sides, 0), axis=-1), np.float64)


MIN_OVERLAP: Final = 0.9
MAX_SCORE_GAP: Final = 0.05


def difference(ours: Sequence[Detection], theirs: Sequence[Detection], confidence: float) -> str | None:
    """Describe how two runtimes' objects differ by more than rounding, or return None.

    What one finds and the other does not counts only if its score is more than MAX_SCORE_GAP above the confidence.
    """
    alike = _alike(ours, theirs)
    lonely = [*_lonely(ours, alike, confidence), *_lonely(theirs, alike.T, confidence)]
    if not lonely:
        return None
    worst = max(lonely, key=lambda found: found.score)
    return f"{len(lonely)} of {len(ours)} and {len(theirs)} objects, such as a {worst.name} of score {worst.score:.2f}"


def _lonely(objects: Sequence[Detection], alike: NDArray[np.bool_], confidence: float) -> list[Detection]:
    certain = confidence + MAX_SCORE_GAP
    return [each for each, others in zip(objects, alike, strict=True) if each.score > certain and not others.any()]


def _alike(ours: Sequence[Detection], theirs: Sequence[Detection]) -> NDArray[np.bool_]:
    """Return ours x theirs: whether two are the same object."""
    same = np.equal.outer([each.label for each in ours], [each.label for each in theirs])
    gaps = np.abs(np.subtract.outer([each.score for each in ours], [each.score for each in theirs]))
    return np.asarray(same & (gaps <= MAX_SCORE_GAP) & (ious(boxes_of(ours), boxes_of(theirs)) >= MIN_OVERLAP))
