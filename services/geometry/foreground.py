"""Which of the readings within a mask are the object's own: background bleeds in at edges and through gaps."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Depths = NDArray[Any]
Bools = NDArray[np.bool_]

_NEIGHBOURS: Final = 0.02
"""Share of the readings that lie close together where there is a surface."""

_GAP_M: Final = 0.06
_GAP_SHARE: Final = 0.02
"""How close that is: so many metres, and so much of the depth itself."""

_FOREIGN: Final = 0.5
"""A surface is foreign when its share of the mask's readings is less than this of its share around the mask."""


def foreground(within: Depths, around: Depths) -> Bools:
    """Return which readings of n objects are their own, n x m.

    within: n x m, readings within each mask, in metres, each row ascending. around: n x k, readings just outside of it,
    each row ascending, NaN where there are fewer.

    Where readings lie dense is a surface. One that goes on outside of the mask more than it fills the mask is something
    behind or before the object; and what is on no surface is where a sensor sees two at once.
    """
    near = max(1, round(within.shape[1] * _NEIGHBOURS))
    starts = within[:, :-near]
    dense = within[:, near:] - starts <= _GAP_M + _GAP_SHARE * starts
    own = np.ones(within.shape, np.bool_)
    for row in np.flatnonzero(~dense.all(axis=1)):
        own[row] = _own(within[row], dense[row], near, around[row])
    return own


def _own(within: Depths, dense: Bools, near: int, around: Depths) -> Bools:
    edges = np.flatnonzero(np.diff(dense, prepend=False, append=False))
    own = np.ones(len(within), np.bool_)
    if not len(edges):
        return own
    first, last = edges[::2], edges[1::2] + near - 1
    inside = (last - first + 1) / len(within)
    slack = _GAP_M + _GAP_SHARE * within[first]
    ends = np.searchsorted(around, np.stack([within[first] - slack, within[last] + slack]))
    outside = (ends[1] - ends[0]) / max(1, np.count_nonzero(around > 0))
    kept = inside >= _FOREIGN * outside
    if not kept.any():
        kept = inside == inside.max()
    own[:] = False
    for start, end in zip(first[kept], last[kept], strict=True):
        own[start : end + 1] = True
    return own
