"""Selects the points of masks that belong to the objects: foreground without outliers; many at once. Pure."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.cloud.points import Floats, Indices, spread

Selection = NDArray[np.bool_]

SAMPLE: Final = 512
AROUND: Final = 256
"""Number of depths of an object, and around it, by which surfaces are selected."""

CLOSE: Final = 2
"""In a surface, the reading this many places farther on in the order of depth is still close: the mixed depths at edges
do not join surfaces."""

GAP: Final = 0.05
"""Maximum gap that counts as close, relative to the depth."""

SUBSTANTIAL: Final = 0.25
"""A surface with at least this share of the largest one's points may be the object."""

HOLLOW: Final = 0.3
"""Gaps up to this share of the object's width are part of it: a mast before its cabin."""

OWN: Final = 2.0
"""A surface whose share of the mask is this many times its share of the surroundings belongs to the object."""

FOREIGN: Final = 3.0
"""One whose share of the surroundings is this many times its share of the mask is an occluder."""

CELLS: Final = 16
"""Cells along the longest side of the grid in which points have neighbours."""

SIDE: Final = CELLS + 3
"""Cells along each with a border on either side, and one for what lies on the far edge."""

MIN_SIDE_M: Final = 1e-4

NEIGHBOURS: Final = 3
"""A point with fewer points than this around it, itself included, is an outlier."""

_STEPS: Final = np.array([SIDE**2, SIDE, 1], np.float32)
_CORNER: Final = np.float32(SIDE**2 + SIDE + 1)


def own(depths: Sequence[Floats], widths: Floats, around: Sequence[Floats]) -> list[Selection | None]:
    """Return which points belong to each object, None for all of them.

    Those on its nearest substantial surface belong to it, and those close behind; the background, seen through gaps or
    beside edges that the mask missed, is on surfaces of its own behind it. But a surface mostly around the mask is
    something before the object, and a substantial surface hardly around it is the object's too: something splits it.

    depths: of each object's points along the view, at least one and all above 0. widths: (n,) how wide it is, in
    metres at 1 m. around: depths just outside of it, some of which may be no readings.
    """
    if not depths:
        return []
    within = np.concatenate(depths).take(spread(np.array([len(depth) for depth in depths]), SAMPLE))
    within.sort(axis=1)
    whose, first, last = _surfaces(within)
    kept = _kept(within, (whose, first, last), widths, _rows(around))
    steps = np.zeros((len(within), SAMPLE + 1), np.int32)
    np.add.at(steps, (whose[kept], first[kept]), 1)
    np.add.at(steps, (whose[kept], last[kept] + 1), -1)
    chosen = steps[:, :SAMPLE].cumsum(axis=1) > 0
    partly = np.zeros(len(within), np.bool_)
    partly[whose[~kept]] = True
    return [
        _near(depth, row, mine) if some else None
        for depth, row, mine, some in zip(depths, within, chosen, partly, strict=True)
    ]


def _surfaces(within: Floats) -> tuple[Indices, Indices, Indices]:
    """Return the object of each surface, and the surface's first and last depth in the ascending rows."""
    dense = np.zeros((len(within), SAMPLE - CLOSE + 2), np.bool_)
    np.less_equal(within[:, CLOSE:], within[:, :-CLOSE] * np.float32(1 + GAP), out=dense[:, 1:-1])
    rows, edges = np.nonzero(dense[:, 1:] != dense[:, :-1])
    return rows[::2], edges[::2], edges[1::2] + (CLOSE - 1)


def _kept(within: Floats, surfaces: tuple[Indices, Indices, Indices], widths: Floats, around: Floats) -> Selection:
    """Return which surfaces belong to the objects."""
    whose, first, last = surfaces
    near, far = within[whose, first], within[whose, last]
    inside = (last - first + 1) / SAMPLE
    substantial = inside >= SUBSTANTIAL * _most(inside, whose, len(within))[whose]
    outside = _shares(around[whose], near, far)
    likely: Selection = substantial & (outside <= FOREIGN * inside)
    likely |= substantial & (_most(likely, whose, len(within)) == 0)[whose]
    front = np.full(len(within), len(whose))
    np.minimum.at(front, whose[likely], np.flatnonzero(likely))
    apart = np.ones(len(whose), np.bool_)
    apart[1:] = (whose[1:] != whose[:-1]) | (near[1:] - far[:-1] > (HOLLOW * widths * within[:, 0])[whose[1:]])
    together = np.cumsum(apart)
    front = front[whose]
    behind = (together == together[front]) & (np.arange(len(whose)) >= front)
    told = np.asarray((around > 0).any(axis=1))
    return np.asarray(behind | substantial & (inside >= OWN * outside) & told[whose])


def _most(values: NDArray[Any], whose: Indices, count: int) -> NDArray[Any]:
    """Return the maximum of each object's values, which are not negative; 0 if there are none."""
    most = np.zeros(count)
    np.maximum.at(most, whose, values)
    return most


def _shares(around: Floats, near: Floats, far: Floats) -> NDArray[Any]:
    """Return the share of each row's readings (NaN for none) between near and far; 0 without readings."""
    met = (around >= near[:, np.newaxis] * (1 - GAP)) & (around <= far[:, np.newaxis] * (1 + GAP))
    return np.asarray(met.sum(axis=1) / np.maximum((around > 0).sum(axis=1), 1))


def _rows(around: Sequence[Floats]) -> Floats:
    """Return at most AROUND of each object's values, NaN for missing readings: (n, AROUND)."""
    rows = np.full((len(around), AROUND), np.nan, np.float32)
    counts = np.array([len(depth) for depth in around])
    some = counts > 0
    rows[some] = np.concatenate(around).take(spread(counts[some], AROUND))
    return np.where((rows > 0) & (rows < np.inf), rows, np.float32(np.nan))


def _near(depth: Floats, ascending: Floats, chosen: Selection) -> Selection:
    """Return for which depths the nearest of the ascending ones is chosen."""
    last = np.flatnonzero(chosen[1:] != chosen[:-1])
    exact = ascending.astype(np.float64)
    near = np.full(len(depth), chosen[0])
    for border in (exact[last] + exact[last + 1]) / 2:
        near ^= depth >= border
    return near


def crowded(objects: Sequence[Floats]) -> list[Selection | None]:
    """Return which of each object's (3, n) points, at least one, have neighbours, None for all of them.

    That is in their cell of a grid around all of its points, or in the next ones.
    """
    counted = np.zeros((len(objects), SIDE**3), np.uint8)
    cells = [_cells(xyz) for xyz in objects]
    for row, each in zip(counted, cells, strict=True):
        np.minimum(np.bincount(each, minlength=SIDE**3), NEIGHBOURS, out=row, casting="unsafe")
    filled = counted > 0
    around = counted.reshape(-1)
    for apart in (1, SIDE, SIDE**2):  # the next cell along each axis; those at the border are empty
        wider = around.copy()
        wider[apart:] += around[:-apart]
        wider[:-apart] += around[apart:]
        around = wider
    enough = around.reshape(counted.shape) >= NEIGHBOURS
    partly = np.asarray((filled > enough).any(axis=1))
    return [row.take(each) if some else None for row, each, some in zip(enough, cells, partly, strict=True)]


def _cells(xyz: Floats) -> Indices:
    """Return the cell of each of the (3, n) points in a grid around all of them."""
    low = xyz.min(axis=1, keepdims=True)
    places = xyz - low
    places *= np.float32(1) / np.maximum(places.max() / np.float32(CELLS), np.float32(MIN_SIDE_M))
    return np.asarray((_STEPS @ np.floor(places, out=places) + _CORNER).astype(np.intp))
