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

_FOREIGN: Final = 12.0
"""A surface that has a greater share of what is around the mask than of the mask itself is foreign when another one is
so many times as much the mask's own."""

_SUPPORT: Final = 0.2
"""The share of the mask that such another one has at least."""

_FAINT: Final = 0.02
"""A share around the mask that says nothing."""


def foreground(within: Depths, around: Depths) -> Bools:
    """Return which readings of n objects are their own, n x m.

    within: n x m, readings within each mask, in metres, each row ascending. around: n x k, readings just outside of it,
    each row ascending, NaN where there are fewer.

    Where readings lie dense is a surface. One that is more around the mask than in it is something behind or before the
    object, if there is another one that may be the object; then what is on no surface is left out too.
    """
    dense = _dense(within)
    own = np.ones(within.shape, np.bool_)
    for row in np.flatnonzero(~dense.all(axis=1)):
        own[row] = _own(within[row], dense[row], around[row])
    return own


def on_surface(within: Depths) -> Bools:
    """Return which of each row's ascending readings, n x m, lie dense; where a sensor sees two surfaces they do not."""
    dense = _dense(within)
    starts = np.zeros((len(within), within.shape[1] + 1), np.int32)
    near = within.shape[1] - dense.shape[1]
    starts[:, 1 : dense.shape[1] + 1] = np.cumsum(dense, axis=1)
    starts[:, dense.shape[1] + 1 :] = starts[:, dense.shape[1], np.newaxis]
    before = np.maximum(np.arange(within.shape[1]) - near, 0)
    return np.asarray(starts[:, 1:] > starts[:, before])


def _dense(within: Depths) -> Bools:
    """Return where each row has a surface's share of readings close behind a reading; not of its last ones."""
    near = max(1, round(within.shape[1] * _NEIGHBOURS))
    starts = within[:, :-near]
    return np.asarray(within[:, near:] - starts <= _GAP_M + _GAP_SHARE * starts)


def _own(within: Depths, dense: Bools, around: Depths) -> Bools:
    edges = (np.flatnonzero(dense[1:] != dense[:-1]) + 1).tolist()
    edges = [*([0] if dense[0] else []), *edges, *([len(dense)] if dense[-1] else [])]
    own = np.ones(len(within), np.bool_)
    if not edges:
        return own
    first, last = np.array(edges[::2]), np.array(edges[1::2]) + (len(within) - len(dense) - 1)
    kept = _kept(within, first, last, around)
    if kept.all():
        return own
    own[:] = False
    for start, end in zip(first[kept], last[kept], strict=True):
        own[start : end + 1] = True
    return own


def _kept(within: Depths, first: NDArray[np.intp], last: NDArray[np.intp], around: Depths) -> Bools:
    """Return which surfaces, from their first to their last reading, are the object's."""
    inside = (last - first + 1) / len(within)
    slack = _GAP_M + _GAP_SHARE * within[first]
    ends = np.searchsorted(around, np.stack([within[first] - slack, within[last] + slack]))
    outside = (ends[1] - ends[0]) / max(1, np.count_nonzero(around > 0))
    owned = inside / (outside + _FAINT)
    most = owned[inside >= _SUPPORT].max(initial=0)
    return np.asarray((inside >= outside) | (owned * _FOREIGN >= most))
