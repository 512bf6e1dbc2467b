"""Solid things cannot be at one place: which objects overlap, and which of these are one. Pure."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.distances import REACHES
from services.worldmodel.classes import Classes
from services.worldmodel.objects import Objects
from services.worldmodel.placement import UNITS, Sightings

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]

HALF: Final = REACHES // 2
NEAR: Final = 1.1
"""Half of both diagonals, by so much, is how far apart the middles of outlines that overlap may be: these are known in
REACHES directions only."""

COVERED: Final = 0.6
"""Share of an object's width and height that a sighting covers if it shows that object too."""

GROWTH: Final = 2.0
"""Edges must have shifted by so many times what the outline has grown, to have moved."""


def overlap(objects: Objects, first: Rows, second: Rows) -> Floats:
    """Return how much pairs of objects overlap, 0 to 1: of the narrower one's width, and of the lower one's height."""
    depth = _depth(objects.outline[first], objects.outline[second])
    narrower = np.minimum(objects.size[first].min(axis=1), objects.size[second].min(axis=1))
    level = np.minimum(objects.high[first], objects.high[second]) - np.maximum(objects.low[first], objects.low[second])
    lower = np.minimum(objects.high[first] - objects.low[first], objects.high[second] - objects.low[second])
    return np.asarray(
        np.clip(depth / np.maximum(narrower, 0.05), 0, 1) * np.clip(level / np.maximum(lower, 0.03), 0, 1)
    )


def may_meet(objects: Objects, classes: Classes, first: Rows, second: Rows) -> NDArray[np.bool_]:
    """Return which pairs of objects of one class are near enough to overlap, or to be parts of one: few of those."""
    one, other = (np.hypot(*objects.size[each].T) / 2 for each in (first, second))
    apart = np.hypot(*(objects.centre[first] - objects.centre[second]).T)
    return np.asarray(apart < np.maximum(NEAR * (one + other), classes.sizes[objects.cls[first], 0] / 2))


def _depth(first: Floats, second: Floats) -> Floats:
    """Return how deep outlines (n, REACHES) are in each other, along the direction in which it is least."""
    one, other = first + np.roll(second, HALF, axis=1), np.roll(first, HALF, axis=1) + second
    return np.asarray(np.minimum(one, other).min(axis=1))


def covers_several(seen: Sightings, objects: Objects, row: Rows, of: Rows, to_right: Floats) -> NDArray[np.bool_]:
    """Return which sightings cover more than one of the objects that they are paired with: several taken for one.

    row, of: pairs of sightings and objects of their class. to_right: (n, 2) level direction of each sighting's image.
    """
    level = np.minimum(seen.high[row], objects.high[of]) - np.maximum(seen.low[row], objects.low[of])
    met = np.flatnonzero(level > COVERED * (objects.high[of] - objects.low[of]))
    row, of = row[met], of[met]
    edges, outline = seen.edges[row], objects.outline[of]
    right = (to_right @ UNITS.T).argmax(axis=1)[row]
    left, each = (right + HALF) % REACHES, np.arange(len(row))
    most = np.minimum(edges[each, right], outline[each, right])
    least = np.maximum(-edges[each, left], -outline[each, left])
    width = outline[each, right] + outline[each, left]
    within = (most - least > COVERED * width) & (_depth(edges, outline) > 0)
    return np.asarray(np.bincount(row[within], minlength=len(seen)) > 1)


def shifted(edges: Floats, before: Floats) -> Floats:
    """Return how far outlines have moved at least, in metres; possible growth at one side is no motion.

    before: NaN for edges that are not known now, or were not then; these tell nothing, nor do those opposite.
    """
    grown = edges - before
    opposite = np.roll(grown, HALF, axis=1)
    shift, growth = np.abs(grown - opposite) / 2, np.abs(grown + opposite) / 2
    return np.asarray(np.where(shift > GROWTH * growth, shift, 0.0).max(axis=1))


OVERLAP: Final = 0.45
"""Overlap from which on two of a class may be one."""

CLEAR: Final = 0.8
"""Overlap that hardly leaves another possibility."""

APART: Final = 2
"""Views, at least, in which one of them was missed in plain view while the other was seen, if any show both."""

TOGETHER: Final = 1.0
TOGETHER_CLEAR: Final = 0.25
"""How many of these there must be per view that shows both: detectors see some things twice."""

MOST_PAIRS: Final = 100_000


class Merger:
    """Remembers which objects in each other's way were seen together, and which one instead of the other."""

    def __init__(self) -> None:
        self._pairs: dict[tuple[int, int], list[int]] = {}

    def doubles(
        self,
        objects: Objects,
        classes: Classes,
        first: Rows,
        second: Rows,
        *,
        together: NDArray[np.bool_],
        apart: NDArray[np.bool_],
    ) -> list[tuple[int, int]]:
        """Return which pairs of objects of one class are one.

        together: the view that showed the first shows the second too. apart: it should have, and does not.
        """
        if not len(first):
            return []
        large = classes.is_large(objects.cls[first])
        away = np.square(objects.centre[first] - objects.centre[second]).sum(axis=1)
        parts = large & (away < np.square(classes.sizes[objects.cls[first], 0] / 2))
        share = np.where(parts, 1.0, overlap(objects, first, second))
        if len(self._pairs) > MOST_PAIRS:
            self._pairs.clear()
        return [
            (int(first[each]), int(second[each]))
            for each in np.flatnonzero(share > OVERLAP).tolist()
            if parts[each]
            or self._are_one(
                int(objects.number[first[each]]),
                int(objects.number[second[each]]),
                float(share[each]),
                together=bool(together[each]),
                apart=bool(apart[each]),
            )
        ]

    def _are_one(self, one: int, other: int, share: float, *, together: bool, apart: bool) -> bool:
        times = self._pairs.setdefault((min(one, other), max(one, other)), [0, 0])
        times[0] += together
        times[1] += apart
        needed = TOGETHER_CLEAR if share > CLEAR else TOGETHER
        return not times[0] or (times[1] >= APART and times[1] > needed * times[0])


def merge(objects: Objects, classes: Classes, one: int, other: int) -> tuple[int, int]:
    """Make two objects one; return the row that is kept, and the one that is not needed any more."""
    kept, lost = (one, other) if _rank(objects, one) >= _rank(objects, other) else (other, one)
    if classes.is_large(objects.cls[[kept]])[0]:
        _add_part(objects, classes, kept, lost)
    objects.logit[kept] = max(objects.logit[kept], objects.logit[lost])
    objects.hits[kept] += objects.hits[lost]
    objects.looks[kept] += objects.looks[lost]
    objects.first_ns[kept] = min(objects.first_ns[kept], objects.first_ns[lost])
    objects.last_ns[kept] = max(objects.last_ns[kept], objects.last_ns[lost])
    return kept, lost


def _rank(objects: Objects, row: int) -> tuple[bool, int, int]:
    return bool(objects.confirmed[row]), int(objects.hits[row]), -int(objects.number[row])


def _add_part(objects: Objects, classes: Classes, kept: int, part: int) -> None:
    """Let an object reach as far as a part of it, though no farther than its class is large."""
    known = np.isfinite(objects.variance[part])
    further = known & ((objects.edges[part] > objects.edges[kept]) | np.isinf(objects.variance[kept]))
    usual = classes.sizes[objects.cls[kept]]
    wide = objects.edges[part] + np.roll(objects.outline[kept], REACHES // 2)
    taken = further & (wide < usual[0] + 2 * usual[3])
    objects.edges[kept, taken] = objects.edges[part, taken]
    objects.variance[kept, taken] = objects.variance[part, taken]
    objects.low[kept] = min(objects.low[kept], objects.low[part])
    objects.high[kept] = max(objects.high[kept], objects.high[part])
