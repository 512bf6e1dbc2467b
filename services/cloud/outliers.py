"""Which points of a mask are the object's: the foreground, less what stands alone. Pure."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.cloud.points import Floats

Selection = NDArray[np.bool_]

STEP: Final = 0.02
"""How finely depths are told apart, relative to the depth."""

GAP_BINS: Final = 2
"""So many steps without points end a surface."""

NOISE: Final = 0.003
"""A step with less than this share of the points counts as one without: edges where two depths are mixed."""

SUBSTANTIAL: Final = 0.25
"""A surface with at least this share of the largest one's points may be the object."""

HOLLOW: Final = 0.3
"""Gaps of up to this share of the object's width are within it: a mast before its cabin."""

CELLS: Final = 16
"""Cells along the longest side of the grid in which points have neighbours."""

BORDERED: Final = 3
"""So many cells more there are along each: a border on either side, and one for what lies on the far edge."""

MIN_SIDE_M: Final = 1e-4

NEIGHBOURS: Final = 3
"""A point with fewer points than this around it, itself included, is an outlier."""


def foreground(depth: Floats, across: Floats) -> Selection:
    """Return which points lie on the nearest substantial surface: n depths along the view, all above 0.

    What shows through gaps, or beside edges that the mask missed, is on surfaces of its own behind it.
    across: (2, n) metres across the view.
    """
    nearest = float(depth.min())
    steps = (np.log(depth / np.float32(nearest)) * np.float32(1 / np.log1p(STEP))).astype(np.int32)
    counts = np.bincount(steps)
    starts, ends = _runs(counts > min(NOISE * len(depth), counts.max() - 1))  # the fullest steps are never empty
    until = np.cumsum(counts)
    weights = until[ends - 1] - until[starts] + counts[starts]
    first = int(np.argmax(weights >= SUBSTANTIAL * weights.max()))
    last = first
    if ends[first] - starts[first] == len(counts):
        return np.ones(len(depth), np.bool_)
    chosen = np.asarray((steps >= starts[first]) & (steps < ends[first]))
    if first + 1 == len(starts):
        return chosen
    width = float(np.ptp(across.compress(chosen, axis=1), axis=1).max())
    last = first
    while (
        last + 1 < len(starts) and _metres(nearest, starts[last + 1]) - _metres(nearest, ends[last]) <= HOLLOW * width
    ):
        last += 1
    return chosen if last == first else np.asarray((steps >= starts[first]) & (steps < ends[last]))


def _metres(nearest: float, step: int) -> float:
    return float(nearest * (1 + STEP) ** int(step))


def _runs(filled: Selection) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where surfaces begin and end; shorter gaps than GAP_BINS are none."""
    bordered = np.zeros(len(filled) + 2, np.bool_)
    bordered[1:-1] = filled
    changes = np.flatnonzero(bordered[1:] != bordered[:-1])
    starts, ends = changes[::2], changes[1::2]
    apart = np.flatnonzero(starts[1:] - ends[:-1] >= GAP_BINS)
    return np.append(starts[:1], starts[apart + 1]), np.append(ends[apart], ends[-1:])


def crowded(xyz: Floats) -> Selection:
    """Return which of (3, n) points have neighbours, in their cell of a grid around all of them or the next ones."""
    low = xyz.min(axis=1, keepdims=True)
    reach = xyz.max(axis=1, keepdims=True) - low
    scale = np.float32(1 / max(float(reach.max()) / CELLS, MIN_SIDE_M))
    x, y, z = ((xyz - low) * scale).astype(np.int32)
    _, depth, width = ((reach * scale).astype(np.int32) + BORDERED)[:, 0].tolist()
    first = (depth + 1) * width + 1  # the cell at the corner, within the border
    cells = (x * depth + y) * width + z + first
    alone = np.bincount(cells, minlength=int(cells.max()) + first + 1)
    counts = alone.astype(np.int32)
    for apart in (1, width, width * depth):  # the next cell along each axis; those at the border are empty
        around = counts.copy()
        around[apart:] += counts[:-apart]
        around[:-apart] += counts[apart:]
        counts = around
    enough = counts >= NEIGHBOURS
    return np.ones(len(cells), np.bool_) if enough[alone > 0].all() else enough.take(cells)
