"""The known objects as arrays, a row each, and which of them are near a place. Pure."""

from collections import Counter
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, fields
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from schemas.distances import REACHES

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

SEERS: Final = 4
"""Cameras that are remembered of an object."""

PLACE_M: Final = 1.0
Place = tuple[int, int]
"""A square of PLACE_M, by its column and row."""

G = TypeVar("G", bound=Hashable)
M = TypeVar("M", bound=Hashable)

_FIRST: Final = 256
_SHAPES: Final[dict[str, tuple[int, ...]]] = {
    "edges": (REACHES,),
    "variance": (REACHES,),
    "outline": (REACHES,),
    "anchor": (REACHES,),
    "anchor_variance": (REACHES,),
    "told_edges": (REACHES,),
    "centre": (2,),
    "hint": (2,),
    "size": (2,),
    "velocity": (2,),
    "told": (3,),
    "covariance": (2, 2),
    "seers": (SEERS,),
    "seers_ns": (SEERS,),
}
_UNKNOWN: Final = {"variance": np.inf, "anchor_variance": np.inf, "told_edges": np.nan} | dict.fromkeys(
    ("number", "anchor_robot", "seers"), -1
)
_WHOLE: Final = frozenset(
    {"number", "cls", "hits", "fits", "first_ns", "last_ns", "looked_ns", "told_ns", "series_ns", "anchor_robot"}
    | {"seers", "seers_ns"}
)


@dataclass(slots=True, eq=False)
class Objects:
    """A site's objects; rows are reused.

    number: of the id, -1 for a row that is free. cls: number of the class. edges, variance: what was measured of the
    outline, infinite variance where nothing was. outline: the edges of the box that fits best. centre, covariance, size
    (length, width), yaw: of that box. hint: about where the centre is, whatever edges are known. low, high: heights;
    low_variance, high_variance: of these. velocity: metres a second.

    anchor, anchor_variance, anchor_robot: the edges as they were before the robot that sees it now began to, and who
    that is; series_ns: when it saw it last. watched_s: how long it was in view, all robots together.

    logit: log-odds that it is there. confirmed: known to others. hits: sightings. looks: views that should have shown
    it. fits: sightings since the box was fitted. first_ns, last_ns, looked_ns: when it was seen first and last, and
    looked for in vain. seers, seers_ns: numbers of the cameras that saw it last, and when.
    told, told_edges, told_ns: the centre (x, y, z) and measured edges as others know them, NaN for those that were not
    measured, and since when.
    """

    number: Whole
    cls: Whole
    edges: Floats
    variance: Floats
    outline: Floats
    centre: Floats
    covariance: Floats
    size: Floats
    yaw: Floats
    hint: Floats
    low: Floats
    high: Floats
    low_variance: Floats
    high_variance: Floats
    velocity: Floats
    anchor: Floats
    anchor_variance: Floats
    anchor_robot: Whole
    series_ns: Whole
    watched_s: Floats
    logit: Floats
    confirmed: NDArray[np.bool_]
    hits: Whole
    looks: Floats
    fits: Whole
    first_ns: Whole
    last_ns: Whole
    looked_ns: Whole
    seers: Whole
    seers_ns: Whole
    told: Floats
    told_edges: Floats
    told_ns: Whole

    @classmethod
    def none(cls, capacity: int = _FIRST) -> "Objects":
        """Return room for so many objects."""
        return cls(**{each.name: _empty(each.name, capacity) for each in fields(cls)})

    @property
    def capacity(self) -> int:
        """The number of rows, free ones included."""
        return len(self.number)

    def grow(self) -> None:
        """Double the number of rows."""
        more = Objects.none(self.capacity)
        for each in fields(self):
            setattr(self, each.name, np.concatenate([getattr(self, each.name), getattr(more, each.name)]))

    def clear(self, rows: Rows) -> None:
        """Make rows as they are before anything is known of them; their numbers stay."""
        for each in fields(self):
            if each.name != "number":
                getattr(self, each.name)[rows] = _UNKNOWN.get(each.name, 0)

    def known(self) -> Rows:
        """Return the rows that are in use."""
        return np.flatnonzero(self.number >= 0)

    def measured(self, rows: Rows | list[int]) -> Floats:
        """Return the edges of rows that were measured, NaN for others (n, REACHES)."""
        return np.where(np.isfinite(self.variance[rows]), self.edges[rows], np.nan)

    def told_to_others(self) -> Rows:
        """Return the rows of confirmed objects."""
        return np.flatnonzero(self.confirmed)

    def forget_seers(self, robots: Rows, cameras: Rows) -> None:
        """Forget which objects were seen by robots and cameras whose numbers are for others from now on."""
        gone = np.isin(self.seers, cameras)
        self.seers[gone], self.seers_ns[gone] = _UNKNOWN["seers"], 0
        self.anchor_robot[np.isin(self.anchor_robot, robots)] = _UNKNOWN["anchor_robot"]

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now: the clock was set back."""
        for each in fields(self):
            if each.name.endswith("_ns"):
                times = getattr(self, each.name)
                np.minimum(times, now_ns, out=times)

    def shift(self, rows: Rows, by: Floats, along: Floats) -> None:
        """Move objects by (n, 2), which is `along` the directions of outlines (n, REACHES)."""
        self.edges[rows] += along
        self.outline[rows] += along
        self.anchor[rows] += along
        self.centre[rows] += by
        self.hint[rows] += by


def _empty(name: str, capacity: int) -> Any:
    kind = np.bool_ if name == "confirmed" else np.int64 if name in _WHOLE else np.float64
    return np.full((capacity, *_SHAPES.get(name, ())), _UNKNOWN.get(name, 0), kind)


class Unconfirmed:
    """Rows of objects that are not confirmed yet: by the robot that brought each, and by place; the oldest are first.

    Places are squares of PLACE_M. "" stands for all robots that were forgotten.
    """

    def __init__(self) -> None:
        self._of: dict[int, tuple[str, Place]] = {}
        self._rows: dict[str, dict[int, None]] = {}
        self._places: dict[Place, dict[int, None]] = {}
        self._by_count: dict[int, dict[str, None]] = {}  # which robots have so many
        self._most = 0

    def add(self, row: int, robot: str, place: Place) -> None:
        """Note a new object."""
        self._of[row] = robot, place
        self._places.setdefault(place, {})[row] = None
        rows = self._rows.setdefault(robot, {})
        rows[row] = None
        self._count(robot, len(rows) - 1, len(rows))

    def drop(self, row: int) -> None:
        """Forget a row, if it is known: its object is confirmed, or gone."""
        known = self._of.pop(row, None)
        if known is None:
            return
        robot, place = known
        _remove(self._places, place, row)
        _remove(self._rows, robot, row)
        left = self.count(robot)
        self._count(robot, left + 1, left)

    def forget(self, robots: Iterable[str]) -> None:
        """Forget who brought the rows of robots."""
        for robot in robots:
            for row in list(self._rows.get(robot, ())):
                place = self._of[row][1]
                self.drop(row)
                self.add(row, "", place)

    def robot(self, row: int) -> str:
        """Return who brought a row."""
        return self._of[row][0]

    def count(self, robot: str) -> int:
        """Return how many rows a robot has."""
        return len(self._rows.get(robot, ()))

    def count_at(self, place: Place) -> int:
        """Return how many rows are at a place."""
        return len(self._places.get(place, ()))

    def instead(self, robot: str) -> int | None:
        """Return the oldest row of the robot that has most of them, if it has more than `robot` would with another."""
        if self._most <= self.count(robot) + 1:
            return None
        return next(iter(self._rows[next(iter(self._by_count[self._most]))]))

    def instead_at(self, place: Place, robot: str) -> int | None:
        """Return the same of the rows at a place."""
        rows = self._places.get(place, {})
        counts = Counter(self._of[row][0] for row in rows)
        if not counts:
            return None
        ((other, most),) = counts.most_common(1)
        return next(row for row in rows if self._of[row][0] == other) if most > counts[robot] + 1 else None

    def _count(self, robot: str, before: int, now: int) -> None:
        if before:
            _remove(self._by_count, before, robot)
        if now:
            self._by_count.setdefault(now, {})[robot] = None
        self._most = max(self._most, now)
        if self._most not in self._by_count:
            self._most = now


def _remove(groups: dict[G, dict[M, None]], group: G, member: M) -> None:
    """Remove a member of a group; groups without any are not kept."""
    del groups[group][member]
    if not groups[group]:
        del groups[group]


def places_of(at: Floats) -> list[Place]:
    """Return the place of PLACE_M that each of (n, 2) is in."""
    found: list[Place] = list(map(tuple, np.floor(at / PLACE_M).astype(np.int64).tolist()))
    return found


CELL_M: Final = 2.0
_WRAP: Final = 1 << 20
_AROUND: Final = tuple(across + up for across in (-_WRAP, 0, _WRAP) for up in (-1, 0, 1))
_NONE: Final = np.empty(0, np.intp)


class Index:
    """Rows of objects by the cell of CELL_M that they are in, and by the nine cells around each."""

    def __init__(self) -> None:
        self._cells: dict[int, list[int]] = {}
        self._cell: dict[int, int] = {}
        self._blocks: dict[int, Rows] = {}

    def put(self, rows: Rows, places: Floats) -> None:
        """Say where rows are now, (n, 2)."""
        for row, cell in zip(rows.tolist(), _cells_of(places), strict=True):
            before = self._cell.get(row)
            if before == cell:
                continue
            if before is not None:
                self._leave(row, before)
            self._cell[row] = cell
            self._cells.setdefault(cell, []).append(row)
            self._changed(cell)

    def drop(self, row: int) -> None:
        """Forget a row, if it is known."""
        cell = self._cell.pop(row, None)
        if cell is not None:
            self._leave(row, cell)

    def near(self, places: Floats) -> tuple[Rows, Rows]:
        """Return pairs of numbers of places (n, 2) and rows that are within CELL_M of them, and some others."""
        return _pairs([self._block(cell) for cell in _cells_of(places)])

    def within(self, low: Floats, high: Floats) -> tuple[Rows, Rows]:
        """Return pairs of numbers of rectangles (n, 2 corners each) and rows that are in them, and some others."""
        lows, highs = (np.floor(each / CELL_M).astype(np.int64).tolist() for each in (low, high))
        found = []
        for (left, bottom), (right, top) in zip(lows, highs, strict=True):
            cells = [x * _WRAP + y for x in range(left + 1, right + 2, 3) for y in range(bottom + 1, top + 2, 3)]
            found.append(np.concatenate([self._block(cell) for cell in cells]))
        return _pairs(found)

    def _block(self, cell: int) -> Rows:
        """Return the rows in the nine cells around and in a cell; only blocks with rows in them are kept."""
        block = self._blocks.get(cell)
        if block is None:
            get = self._cells.get
            rows = [row for step in _AROUND for row in get(cell + step, ())]
            if not rows:
                return _NONE
            block = self._blocks[cell] = np.array(rows, np.intp)
        return block

    def _changed(self, cell: int) -> None:
        for step in _AROUND:
            self._blocks.pop(cell + step, None)

    def _leave(self, row: int, cell: int) -> None:
        rows = self._cells[cell]
        rows.remove(row)
        if not rows:
            del self._cells[cell]
        self._changed(cell)


def _pairs(found: list[Rows]) -> tuple[Rows, Rows]:
    if not found:
        return _NONE, _NONE
    return np.repeat(np.arange(len(found)), [len(rows) for rows in found]), np.concatenate(found)


def _cells_of(places: Floats) -> list[int]:
    cells = np.floor(places / CELL_M).astype(np.int64)
    numbers: list[int] = (cells[:, 0] * _WRAP + cells[:, 1]).tolist()
    return numbers
