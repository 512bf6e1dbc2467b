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
    taken = spread(count, wanted)
    new = np.empty(wanted, np.bool_)
    new[0] = True
    np.not_equal(taken[1:], taken[:-1], out=new[1:])
    return taken[new]


def spread(count: int, wanted: int) -> Indices:
    """Return exactly `wanted` ascending numbers below `count`, as `some` spreads them; some of them twice."""
    return (_jittered(wanted) * (count / wanted)).astype(np.intp)


def _jittered(wanted: int) -> NDArray[np.float64]:
    return _JITTERED[:wanted] if wanted <= len(_JITTER) else np.asarray(np.arange(wanted) + np.resize(_JITTER, wanted))
