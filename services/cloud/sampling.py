"""Some of many points. Pure."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.cloud.points import Indices

_JITTER: Final = np.random.default_rng(0).random(2048)
_JITTERED: Final = np.arange(len(_JITTER)) + _JITTER


def some(count: int, wanted: int) -> Indices:
    """Return ascending numbers below `count`, all of them or about `wanted`, and never more than that.

    They are spread evenly but not regularly: of rows of points a regular step may take a single column.
    """
    if count <= wanted:
        return np.arange(count)
    taken = (_jittered(wanted) * (count / wanted)).astype(np.intp)
    new = np.empty(wanted, np.bool_)
    new[0] = True
    np.not_equal(taken[1:], taken[:-1], out=new[1:])
    return taken[new]


def spread(counts: Indices, wanted: int) -> Indices:
    """Return exactly `wanted` ascending numbers of each of n ranges that follow each other from 0 on: (n, wanted).

    counts: (n,) how long they are. The numbers are spread as `some` does it, and some of them are there twice.
    """
    each = counts[:, np.newaxis]
    return np.asarray(each.cumsum(axis=0) - each + (_jittered(wanted) * (each / wanted)).astype(np.intp))


def _jittered(wanted: int) -> NDArray[np.float64]:
    return _JITTERED[:wanted] if wanted <= len(_JITTER) else np.asarray(np.arange(wanted) + np.resize(_JITTER, wanted))
