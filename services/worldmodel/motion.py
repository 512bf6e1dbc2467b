"""Follows objects that move in view: one that is missed at its place and found close by keeps its id. Pure."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.distances import REACHES
from services.worldmodel.association import Assignment, displaced
from services.worldmodel.classes import Classes
from services.worldmodel.evidence import Looks
from services.worldmodel.fusion import hints
from services.worldmodel.objects import Objects
from services.worldmodel.placement import HALF, UNITS, Sightings

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]

NS: Final = 1e9
DRIFT_M: Final = 0.15
"""How far a thing of a class that moves must seem to be from its place to have moved."""

LONGEST_S: Final = 1.5
"""Things are followed over gaps of at most this."""

FASTEST_M_S: Final = 3.0
SETTLED: Final = 2
"""Things that were not seen more often are not followed."""

SLACK_M: Final = 0.3
LEVEL_M: Final = 0.25
"""Things keep their height while they move, to within this at either end."""

VARIANCE_M2: Final = 0.09
"""Of edges of what has just moved: the next sightings settle them anew."""

CLEAR_M: Final = 6.0
"""Objects farther away are seen too coarsely to tell a motion."""

WHOLE: Final = 0.2
"""Share by which the width of what has moved may differ from what it was."""

RIGID_M: Final = 0.06
RIGID: Final = 0.25
"""By so much, or this share of the motion, edges of what has moved may be off from where it took them."""

SMOOTHING: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """seen: rows of sightings, of: rows of objects, pairwise; by: (n, 2) metres."""

    seen: Rows
    of: Rows
    by: Floats


def moves(
    seen: Sightings,
    objects: Objects,
    classes: Classes,
    found: Assignment,
    *,
    looks: Looks,
    pairs: tuple[Rows, Rows],
    at_ns: NDArray[np.int64],
) -> Moves:
    """Return which sightings of nothing known are of objects that have moved since they were last seen.

    pairs: of sightings and objects near them. at_ns: of each view. An object that does not move by itself must be seen
    to have left its place; one that does must not be seen there still.
    """
    row, of = pairs
    free = np.zeros(len(seen), np.bool_)
    free[found.new] = True
    alike = np.flatnonzero(free[row] & (seen.classes[row] == objects.cls[of]))
    row, of = row[alike], of[alike]
    passed = (at_ns[seen.frame[row]] - objects.last_ns[of]) / NS
    lately = (passed > 0) & (passed < LONGEST_S) & (objects.hits[of] > SETTLED)
    kept = np.flatnonzero(lately & ~np.isin(of, found.of))
    row, of, passed = row[kept], of[kept], passed[kept]
    by = hints(seen, classes)[row] - objects.hint[of]
    expected = objects.velocity[of] * passed[:, np.newaxis]
    apart = np.hypot(*(by - expected).T)
    key = seen.frame[row] * objects.capacity + of
    looked = looks.frame * objects.capacity + looks.rows
    left, there = np.isin(key, looked[looks.past]), np.isin(key, looked[~looks.past])
    level = np.maximum(np.abs(seen.low[row] - objects.low[of]), np.abs(seen.high[row] - objects.high[of])) < LEVEL_M
    mobile = classes.moves[objects.cls[of]]
    by_itself = mobile & ~there & _is_whole(seen, objects, row, of) & _is_rigid(seen, objects, row, of, by)
    carried = ~mobile & left & level
    good = np.flatnonzero((by_itself | carried) & (apart < SLACK_M + FASTEST_M_S * passed))
    order = good[np.argsort(apart[good], kind="stable")]
    chosen: list[int] = []
    taken: set[int] = set()
    given: set[int] = set()
    for each, sighting, thing in zip(order.tolist(), row[order].tolist(), of[order].tolist(), strict=True):
        if sighting not in taken and thing not in given:
            chosen.append(each)
            taken.add(sighting)
            given.add(thing)
    which = np.array(chosen, np.intp)
    return Moves(row[which], of[which], by[which])


def drifts(seen: Sightings, objects: Objects, classes: Classes, found: Assignment) -> Moves:
    """Return which of the sightings of known things show that these have moved a little."""
    far = np.hypot(*found.moved.T) > DRIFT_M
    kept = np.flatnonzero(far & classes.moves[objects.cls[found.of]])
    kept = kept[_is_whole(seen, objects, found.seen[kept], found.of[kept])]
    kept = kept[_is_rigid(seen, objects, found.seen[kept], found.of[kept], found.moved[kept])]
    _, once = np.unique(found.of[kept], return_index=True)
    kept = kept[once]
    return Moves(found.seen[kept], found.of[kept], found.moved[kept])


def _is_whole(seen: Sightings, objects: Objects, row: Rows, of: Rows) -> NDArray[np.bool_]:
    """Return which sightings show both ends of an object, and as much between them as there is of the object."""
    across = np.stack([-seen.away[row, 1], seen.away[row, 0]], axis=1)
    left = (across @ UNITS.T).argmax(axis=1)
    right = (left + HALF) % REACHES
    width = seen.edges[row, left] + seen.edges[row, right]
    usual = objects.outline[of, left] + objects.outline[of, right]
    measured = np.isfinite(seen.noise[row])
    near = measured | np.roll(measured, 1, axis=1) | np.roll(measured, -1, axis=1)  # directions are 30 degrees apart
    each = np.arange(len(row))
    ends = near[each, left] & near[each, right]
    return np.asarray(ends & (np.abs(width - usual) < WHOLE * usual) & (seen.depth[row] < CLEAR_M))


def _is_rigid(seen: Sightings, objects: Objects, row: Rows, of: Rows, by: Floats) -> NDArray[np.bool_]:
    """Return of which sightings all edges that were known are off by one motion, about `by` (n, 2): parts are not."""
    about = by
    by, _ = displaced(seen.edges[row], seen.noise[row], objects.edges[of], objects.variance[of])
    known = np.isfinite(seen.noise[row]) & np.isfinite(objects.variance[of])
    apart = np.where(known, seen.edges[row] - objects.edges[of] - by @ UNITS.T, 0.0)
    rest = np.sqrt(np.square(apart).sum(axis=1) / np.maximum(known.sum(axis=1), 1))
    far = np.hypot(*by.T)
    return np.asarray((rest < np.maximum(RIGID_M, RIGID * far)) & (np.hypot(*(by - about).T) < SLACK_M + RIGID * far))


def move(objects: Objects, moved: Moves, passed: Floats) -> None:
    """Move objects to where they were seen. passed: seconds since they were seen last."""
    rows = moved.of
    objects.shift(rows, moved.by, moved.by @ UNITS.T)
    known = np.isfinite(objects.variance[rows])
    objects.variance[rows] = np.where(known, np.maximum(objects.variance[rows], VARIANCE_M2), np.inf)
    objects.anchor_variance[rows] = np.inf
    speed = moved.by / np.maximum(passed, 0.05)[:, np.newaxis]
    objects.velocity[rows] += SMOOTHING * (speed - objects.velocity[rows])
