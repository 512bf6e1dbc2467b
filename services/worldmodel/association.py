"""Assigns the sightings of each view to known objects, one to one, so that all of it together is likeliest. Pure."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import lap
import numpy as np
from numpy.typing import NDArray

from services.worldmodel.objects import Objects
from services.worldmodel.placement import UNITS, Sightings

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]

GATE: Final = 16.0
"""Cost from which on a sighting is rather something new: about a chi-square of three degrees of freedom at 99.9 %."""

REACH_M: Final = 1.0
"""The middle of what is seen of an object is within this of its box, half its length around its centre."""

SHAPE_M: Final = 0.06
"""How much two outlines of one object differ beyond their noise, 1 sigma."""

PART: Final = 0.3
"""How much less it costs that an edge falls short of the object's: it may be hidden."""

MOST_SHAPE: Final = 6.0
MOST_LEVEL: Final = 9.0
LEVEL_M: Final = 0.03
LEVEL_SHARE: Final = 0.05
"""How much heights of one object differ beyond their noise, 1 sigma: metres, and share of its height."""

MEETING: Final = 0.3
"""Share of the lower one's height that a sighting and its object have in common, at least."""

_NOTHING_KNOWN: Final = np.array([1e-2, 0.0, 1e-2])
"""Information, of a standard deviation of 10 m, about places that no edge settles."""

_UNIT_PAIRS: Final = np.stack([UNITS[:, 0] ** 2, UNITS[:, 0] * UNITS[:, 1], UNITS[:, 1] ** 2], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Assignment:
    """Which sightings are of which objects: rows `seen` and `of`, pairwise.

    moved: (n, 2) where each sighting is, less where its object was. new: sightings of nothing known.
    """

    seen: Rows
    of: Rows
    moved: Floats
    new: Rows


def assign(seen: Sightings, objects: Objects, row: Rows, of: Rows, pose: Floats) -> Assignment:
    """Assign sightings to objects. row, of: the pairs to consider.

    pose: (n, 3; xx, xy, yy) covariance of each sighting's place that comes from the robot's pose.
    """
    cost, moved = _costs(seen, objects, row, of, pose)
    good = np.flatnonzero(cost < GATE)
    row, of, moved = row[good], of[good], moved[good]
    chosen = _chosen(seen.frame[row], row, of, cost[good])
    free = np.ones(len(seen), np.bool_)
    free[row[chosen]] = False
    return Assignment(row[chosen], of[chosen], moved[chosen], np.flatnonzero(free))


def close(seen: Sightings, objects: Objects, row: Rows, of: Rows) -> tuple[Rows, Rows]:
    """Return those of the pairs of sightings and objects of one class that are near enough, and level, to be one."""
    alike = seen.classes[row] == objects.cls[of]
    return near(seen, objects, row[alike], of[alike])


def near(seen: Sightings, objects: Objects, row: Rows, of: Rows) -> tuple[Rows, Rows]:
    """Return those of the pairs of sightings and objects that are near enough to be one, of whatever classes."""
    reach = REACH_M + objects.size[of, 0] / 2
    x, y = (seen.middle[row] - objects.centre[of]).T
    kept = (np.abs(x) < reach) & (np.abs(y) < reach)
    row, of = row[kept], of[kept]
    level = np.minimum(seen.high[row], objects.high[of]) >= np.maximum(seen.low[row], objects.low[of])
    return row[level], of[level]


def displaced(edges: Floats, noise: Floats, reference: Floats, variance: Floats) -> tuple[Floats, Floats]:
    """Return how far outlines are moved against others (n, 2), by edges known of both, and its covariance (n, 3)."""
    weights = 1 / (noise + variance + SHAPE_M**2)
    return _displaced(weights, np.where(weights > 0, edges - reference, 0.0))


def _displaced(weights: Floats, apart: Floats) -> tuple[Floats, Floats]:
    xx, xy, yy = (weights @ _UNIT_PAIRS + _NOTHING_KNOWN).T
    bx, by = ((weights * apart) @ UNITS).T
    det = xx * yy - xy * xy
    moved = np.stack([(yy * bx - xy * by) / det, (xx * by - xy * bx) / det], axis=1)
    return moved, np.stack([yy / det, -xy / det, xx / det], axis=1)


def _costs(seen: Sightings, objects: Objects, row: Rows, of: Rows, pose: Floats) -> tuple[Floats, Floats]:
    noise, variance = seen.noise[row], objects.variance[of]
    unsure = np.isinf(variance)
    guessed = np.square(0.5 * objects.size[of, 1:]) + 0.01
    weights = 1 / (noise + np.where(unsure, guessed, variance) + SHAPE_M**2)
    apart = seen.edges[row] - np.where(unsure, objects.outline[of], objects.edges[of])
    moved, covariance = _displaced(weights, apart)
    xx, xy, yy = (covariance + pose[row]).T
    x, y = moved.T
    place = (yy * x * x - 2 * xy * x * y + xx * y * y) / np.maximum(xx * yy - xy * xy, 1e-12)
    left = apart - moved @ UNITS.T
    left = np.where(left < 0, PART * left, left)
    measured = np.maximum(np.isfinite(noise).sum(axis=1), 1)
    shape = 3 * np.einsum("nr,nr,nr->n", weights, left, left) / measured
    return place + np.minimum(shape, MOST_SHAPE) + _levels(seen, objects, row, of), moved


def _levels(seen: Sightings, objects: Objects, row: Rows, of: Rows) -> Floats:
    """Return what the difference in height costs; where an end is hidden, only what sticks out."""
    low, high = seen.low[row] - objects.low[of], seen.high[row] - objects.high[of]
    tall = np.maximum(objects.high[of] - objects.low[of], 0.1)
    slack = seen.height_noise[row] + LEVEL_M**2 + np.square(LEVEL_SHARE * tall)
    low = np.where((low > 0) & ~seen.low_known[row], 0, low)
    high = np.where((high < 0) & ~seen.high_known[row], 0, high)
    common = np.minimum(seen.high[row], objects.high[of]) - np.maximum(seen.low[row], objects.low[of])
    lower = np.minimum(tall, seen.high[row] - seen.low[row])
    return np.asarray(
        np.minimum(low * low / (slack + objects.low_variance[of]), MOST_LEVEL)
        + np.minimum(high * high / (slack + objects.high_variance[of]), MOST_LEVEL)
        + np.where(common < MEETING * lower, GATE, 0)
    )


def _chosen(frame: Rows, row: Rows, of: Rows, cost: Floats) -> Rows:
    """Return which pairs are chosen: the cheapest in all of each view, an unassigned sighting costing GATE.

    Mostly each sighting has its own likeliest object: then these are it. Only other views are a matter of weighing.
    """
    if not len(row):
        return row
    _, column = np.unique(frame * (int(of.max()) + 1) + of, return_inverse=True)
    order = np.lexsort((cost, row))
    best = order[np.diff(row[order], prepend=-1) > 0]  # of each sighting
    contested = np.unique(frame[best[np.bincount(column[best])[column[best]] > 1]])
    settled = best[np.isin(frame[best], contested, invert=True)]
    rest = np.flatnonzero(np.isin(frame, contested))
    rest = rest[np.argsort(frame[rest], kind="stable")]
    weighed = _cheapest(frame[rest], row[rest], column[rest], cost[rest])
    return np.concatenate([settled, *(rest[each] for each in weighed)])


def _cheapest(frame: Rows, row: Rows, column: Rows, cost: Floats) -> Iterator[Rows]:
    """Yield the pairs of each view that are cheapest in all. frame: sorted. row, column: numbered view by view."""
    starts = np.flatnonzero(np.diff(frame, prepend=-1))
    if not len(starts):
        return
    counts = np.diff(starts, append=len(frame))
    row, column = (each - np.repeat(np.minimum.reduceat(each, starts), counts) for each in (row, column))
    heights, widths = (np.maximum.reduceat(each, starts) + 1 for each in (row, column))
    ends = np.cumsum(heights * widths)
    cells = np.repeat(ends - heights * widths, counts) + row * np.repeat(widths, counts) + column
    costs, numbers = np.full(ends[-1], 2 * GATE), np.full(ends[-1], -1, np.intp)
    costs[cells], numbers[cells] = cost, np.arange(len(frame))
    for end, height, width in zip(ends.tolist(), heights.tolist(), widths.tolist(), strict=True):
        table = slice(end - height * width, end)
        _, taken, _ = lap.lapjv(costs[table].reshape(height, width), extend_cost=True, cost_limit=GATE)
        matched = np.flatnonzero(taken >= 0)
        chosen = numbers[table][matched * width + taken[matched]]
        yield chosen[chosen >= 0]


def once_each(rows: Rows) -> Iterator[Rows]:
    """Yield the numbers of rows in groups in which each row is once."""
    rest = np.arange(len(rows))
    while len(rest):
        _, first = np.unique(rows[rest], return_index=True)
        yield rest[np.sort(first)]
        rest = np.delete(rest, first)
