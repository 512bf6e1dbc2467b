"""Some of many points. Pure."""

from typing import Final

import numpy as np

from services.cloud.points import Indices

_JITTER: Final = np.random.default_rng(0).random(2048)


def some(count: int, wanted: int) -> Indices:
    """Return ascending numbers below `count`, all of them or about `wanted`, and never more than that.

    They are spread evenly but not regularly: of rows of points a regular step may take a single column.
    """
    if count <= wanted:
        return np.arange(count)
    places = (np.arange(wanted) + np.resize(_JITTER, wanted)) * (count / wanted)
    taken = places.astype(np.intp)
    return taken[np.diff(taken, prepend=-1) > 0]
