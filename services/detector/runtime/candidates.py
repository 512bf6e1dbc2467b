"""Candidate objects of one image, and their suppression. Pure."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Corners in pixels of the input (n x 4), scores (n), labels (n) and mask coefficients (n x m)."""

    corners: Floats
    scores: Floats
    labels: NDArray[np.int64]
    coefficients: Floats

    def __getitem__(self, which: NDArray[np.int64] | NDArray[np.bool_] | slice) -> "Candidates":
        return Candidates(self.corners[which], self.scores[which], self.labels[which], self.coefficients[which])


Integers = NDArray[np.int64]

BLOCK: Final = 256
"""Boxes that are compared with each other, and with those kept, at once."""


def suppressed(corners: Floats, labels: Integers, iou: float, most: int) -> Integers:
    """Return which boxes, best first, overlap no kept better box of their class by more than `iou`.

    corners: n x 4, left, top, right, bottom. most: how many are kept at most.
    """
    left, top, right, bottom = np.ascontiguousarray(corners.T)
    areas = (right - left) * (bottom - top)

    def doubles(these: Integers, others: Integers) -> NDArray[np.bool_]:
        wide = _shared(left, right, these, others)
        shared = wide * _shared(top, bottom, these, others)
        overlap = shared > iou * (areas[these, None] + areas[others] - shared)
        return np.asarray(overlap & (labels[these, None] == labels[others]))

    kept = np.empty(0, np.int64)
    for begin in range(0, len(corners), BLOCK):
        block = np.arange(begin, min(begin + BLOCK, len(corners)))
        block = block[~doubles(block, kept).any(axis=1)]
        kept = np.concatenate([kept, block[_best(doubles(block, block))]])[:most]
        if len(kept) == most:
            break
    return kept


def _shared(begins: Floats, ends: Floats, these: Integers, others: Integers) -> Floats:
    """Return the overlap of each pair along one axis."""
    sides = np.minimum(ends[these, None], ends[others])
    sides -= np.maximum(begins[these, None], begins[others])
    return np.maximum(sides, 0, out=sides)


def _best(doubles: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which boxes are not duplicates of an earlier box that is kept."""
    kept = np.ones(len(doubles), np.bool_)
    for n, of_this in enumerate(doubles):
        if kept[n]:
            kept[n + 1 :] &= ~of_this[n + 1 :]
    return kept
