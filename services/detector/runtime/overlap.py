"""Computes the overlap of boxes, also where the image border may cut them, and compares two models' objects. Pure.

Boxes are corners in pixels (n x 4: left, top, right, bottom), sizes an image's width and height.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection, Mask
from services.geometry.masks import decode

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

    cut: the boxes' sides that were at the border. A part that comes into view there belongs to the box if it was found.
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


LEAST_SEEN: Final = 0.2
"""Share of the pictures in which one must find objects for two to be compared."""
LEAST_EQUAL: Final = 0.99
"""Share of the pictures in which both must find the same classes, and of the clear objects that both must find."""
CLEAR: Final = 0.5
"""Score from which on an object is clear."""
SAME: Final = 0.5
"""IoU from which on two boxes of a class are one object's."""
LEAST_IOU: Final = 0.95
"""Of boxes, and of masks, that both find of the same objects, on average; of the shipped model in INT8 it is 0.99."""


@dataclass(slots=True)
class Comparison:
    """Counts what two models found in the same pictures. equal: pictures in which both found the same classes.

    seen: pictures with objects. clear, missing: objects whose score is high, and those of them that the other model did
    not find. boxes, masks: IoUs of objects that both found.
    """

    pictures: int = 0
    seen: int = 0
    equal: int = 0
    clear: int = 0
    missing: int = 0
    boxes: list[float] = field(default_factory=list)
    masks: list[float] = field(default_factory=list)

    def add(self, ours: Sequence[Detection], theirs: Sequence[Detection]) -> None:
        """Count the objects of one more picture."""
        self.pictures += 1
        self.seen += bool(ours)
        self.equal += {each.name for each in ours} == {each.name for each in theirs}
        same = np.equal.outer(*(np.array([each.name for each in found], np.str_) for found in (ours, theirs)))
        overlaps = ious(boxes_of(ours), boxes_of(theirs)) * same
        for found, others in ((ours, overlaps), (theirs, overlaps.T)):
            both = [others[n].max(initial=0) >= SAME for n, each in enumerate(found) if each.score >= CLEAR]
            self.clear += len(both)
            self.missing += both.count(False)
        for each, others in zip(ours, overlaps, strict=True):
            if (overlap := others.max(initial=0)) >= SAME:
                self.boxes.append(float(overlap))
                mask, other = each.mask, theirs[int(others.argmax())].mask
                if mask is not None and other is not None:
                    self.masks.append(_mask_iou(mask, other))

    def too_different(self) -> str | None:
        """Return what is too different, or None."""
        most = f"at most {round((1 - LEAST_EQUAL) * 100)} in 100 may"
        if self.seen < LEAST_SEEN * self.pictures:
            return f"the model finds objects in {self.seen} of {self.pictures} pictures, too few to compare"
        if self.equal < LEAST_EQUAL * self.pictures:
            other = self.pictures - self.equal
            return f"of {self.pictures} pictures {other} get other classes, {most}"
        if self.missing > (1 - LEAST_EQUAL) * self.clear:
            return f"of {self.clear} clear objects {self.missing} are found by one alone, {most}"
        for what, overlaps in (("boxes", self.boxes), ("masks", self.masks)):
            if overlaps and (mean := float(np.mean(overlaps))) < LEAST_IOU:
                return f"{what} of the same objects have an IoU of {mean:.2f}, not {LEAST_IOU}"
        return None


def _mask_iou(one: Mask, other: Mask) -> float:
    """Return the IoU of two masks of one image."""
    windows = decode(one), decode(other)
    top, left = (max(getattr(each, side) for each in windows) for side in ("top", "left"))
    bottom = min(each.top + each.pixels.shape[0] for each in windows)
    right = min(each.left + each.pixels.shape[1] for each in windows)
    both = 0
    if top < bottom and left < right:
        ours, theirs = (
            each.pixels[top - each.top : bottom - each.top, left - each.left : right - each.left] for each in windows
        )
        both = int(np.count_nonzero(ours & theirs))
    either = windows[0].area + windows[1].area - both
    return both / either if either else 1.0
