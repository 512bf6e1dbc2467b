"""Which of the readings within a mask are the object's own: background bleeds in at edges and through gaps."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Depths = NDArray[Any]

SUPPORT: Final = 0.25
"""Of all readings in a mask: a surface that has less is no object's foreground, but something in front of it."""

_NEIGHBOURS: Final = 0.02
_GAP_M: Final = 0.06
_GAP_SHARE: Final = 0.02


@dataclass(frozen=True, slots=True)
class Foreground:
    """Depths in metres between which an object's readings lie."""

    nearest_m: float
    farthest_m: float


def foreground(ascending: Depths) -> Foreground:
    """Return where the object is in the depths of a mask's pixels, in metres, ascending, at least one.

    Readings form surfaces where they lie dense; the nearest surface with enough of them is the object.
    """
    near = max(1, int(len(ascending) * _NEIGHBOURS))
    starts = ascending[:-near]
    dense = ascending[near:] - starts <= _GAP_M + _GAP_SHARE * starts
    edges = np.flatnonzero(np.diff(dense, prepend=False, append=False))
    if not len(edges):
        return Foreground(float(ascending[0]), float(ascending[-1]))
    first, last = edges[::2], edges[1::2] + near - 1
    counts = last - first + 1
    enough = np.flatnonzero(counts >= SUPPORT * len(ascending))
    chosen = enough[0] if len(enough) else counts.argmax()
    return Foreground(float(ascending[first[chosen]]), float(ascending[last[chosen]]))
