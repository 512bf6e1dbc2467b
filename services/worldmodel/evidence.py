"""What views say of objects that they do not show: hidden, out of view, looked past, or there but missed. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.worldmodel.classes import MAX_CLASSES
from services.worldmodel.frames import Frames
from services.worldmodel.objects import CELL_M, Index, Objects
from services.worldmodel.placement import NOISE_PER_M2, Sightings

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]

NEAREST_M: Final = 0.6
FARTHEST_M: Final = 9.0
"""Depth beyond is too coarse to say that something is gone."""

MARGIN_M: Final = 0.12
MARGIN_SIGMAS: Final = 3.0
"""Depth must be behind an object's near side by so much, and by so many of its standard deviations, to be past it."""

INSIDE: Final = 0.6
"""Share of an object's probed points that must be in view, and unhidden, for a miss to count."""

MIN_PASSED_SHARE: Final = 0.75
"""Share of the points in view that must be looked past."""

BACKGROUND_MARGINS: Final = 1.2
"""By so many margins what an object stands on must be behind a probed point for the point to tell anything."""

FEWEST: Final = 2
"""Probed points, at least, that must tell that a view looks past an object."""

LEVEL_M: Final = 0.05
"""Above a point by less than this, a camera sees past it as far as it can."""

ASIDE: Final = 0.6
LEVELS: Final = (0.35, 0.75, 0.95)
"""Where on its near side an object is probed: in the middle and so far aside, at these shares of its height.

What is behind the upper edge of low things is the farthest, so that level tells the most of them. As it may miss an
object, an object is in plain view where the levels below it are.
"""

PROBES: Final = 3 * len(LEVELS)
PLAIN: Final = PROBES - 3
"""Those below the upper edge."""

_LOW_ROWS: Final = np.repeat((0.7, 0.8, 0.9), 8)
_LOW_COLUMNS: Final = np.tile((np.arange(8) + 0.5) / 8, 3)
"""Where in its grid a view is asked for the floor, as shares of the grid's height and width."""

FLOOR_VIEWS: Final = 9
"""Of so many views of a camera the median says how high the floor is: a few that show a pit do not change it."""

DEEPER_M: Final = 0.5
"""What is seen so much deeper than any floor is none: depth is wrong."""

NAMED_NS: Final = 60_000_000_000
"""A model that never gave a class, in so long, is taken not to know it."""

NAMED_TIMES: Final = 5
"""A model that gave a class less often may have done so by mistake."""

MOST_MODELS: Final = 256


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """Objects that views should show. frame: of the view. rows: of the object. past: the view looks past its place.

    distance: along the optical axis, metres.
    """

    frame: Rows
    rows: Rows
    past: NDArray[np.bool_]
    distance: Floats

    def taken(self, which: Rows | NDArray[np.bool_]) -> "Looks":
        """Return some of them."""
        return Looks(self.frame[which], self.rows[which], self.past[which], self.distance[which])

    def not_past(self, which: NDArray[np.bool_]) -> "Looks":
        """Return them, some of which do not say that the place is empty."""
        return Looks(self.frame, self.rows, self.past & ~which, self.distance)


def look(frames: Frames, camera: Floats, rotation: Floats, objects: Objects, index: Index) -> Looks:
    """Tell which objects are in plain view of cameras, and which of these they look past.

    camera, rotation: of each view's optical frame in the map.
    """
    frame, near = _ahead(frames, camera, rotation, objects, index)
    points = _probes(objects, near, camera[frame], rotation[frame])
    depth = points[..., 2]
    fx, fy, cx, cy = (each[:, np.newaxis] for each in frames.lens[frame].T)
    columns, rows = frames.columns[frame][:, np.newaxis], frames.rows[frame][:, np.newaxis]
    safe = np.maximum(depth, 0.05)
    column, row = fx * points[..., 0] / safe + cx, fy * points[..., 1] / safe + cy
    inside = (depth > NEAREST_M) & (column >= 0.5) & (column < columns - 0.5) & (row >= 0.5) & (row < rows - 0.5)
    cell = frames.starts[frame][:, np.newaxis] + np.where(inside, row, 0).astype(np.intp) * columns
    cell += np.where(inside, column, 0).astype(np.intp)
    near_m, far_m = frames.near_mm.take(cell) / 1000.0, frames.far_mm.take(cell) / 1000.0
    margin = MARGIN_M + MARGIN_SIGMAS * NOISE_PER_M2 * depth * depth
    plain = inside & (near_m > 0) & (far_m >= depth - margin)
    telling = plain & (_behind(objects, near, camera[frame], depth) > depth + BACKGROUND_MARGINS * margin)
    past = telling & (near_m > depth + margin)
    count, distance = plain[:, :PLAIN].sum(axis=1), depth.mean(axis=1)
    kept = np.flatnonzero((count >= INSIDE * PLAIN) & (distance < FARTHEST_M) & (distance > NEAREST_M))
    least = np.maximum(MIN_PASSED_SHARE * telling.sum(axis=1)[kept], FEWEST)
    return Looks(frame[kept], near[kept], past.sum(axis=1)[kept] >= least, distance[kept])


def _ahead(frames: Frames, camera: Floats, rotation: Floats, objects: Objects, index: Index) -> tuple[Rows, Rows]:
    """Return pairs of views and objects in the sector that a view looks into."""
    ahead = rotation[:, :2, 2] / np.maximum(np.hypot(*rotation[:, :2, 2].T), 1e-6)[:, np.newaxis]
    middle = camera[:, :2] + ahead * (FARTHEST_M / 2)
    reach = FARTHEST_M / 2 + CELL_M / 2
    frame, rows = index.within(middle - reach, middle + reach)
    away = objects.centre[rows] - camera[frame, :2]
    forward = np.einsum("nk,nk->n", away, ahead[frame])
    side = np.abs(away[:, 1] * ahead[frame, 0] - away[:, 0] * ahead[frame, 1])
    wide = frames.columns / (2 * frames.lens[:, 0]) + 0.1
    kept = (forward > 0) & (side < wide[frame] * forward + 0.5) & (forward < FARTHEST_M + 1)
    return frame[kept], rows[kept]


def _levels(objects: Objects, near: Rows) -> Floats:
    """Return the heights at which objects are probed, (n, LEVELS)."""
    low, tall = objects.low[near], objects.high[near] - objects.low[near]
    return np.stack([low + share * tall for share in LEVELS], axis=1)


def _behind(objects: Objects, near: Rows, camera: Floats, depth: Floats) -> Floats:
    """Return how far one sees at least past probes (n, PROBES): to what an object stands on, if nothing is nearer."""
    above = camera[:, 2:] - np.repeat(_levels(objects, near), PROBES // len(LEVELS), axis=1)
    down = camera[:, 2:] - objects.low[near][:, np.newaxis]
    return np.where(above > LEVEL_M, depth * down / np.maximum(above, LEVEL_M), np.inf)


def _probes(objects: Objects, near: Rows, camera: Floats, rotation: Floats) -> Floats:
    """Return PROBES points on each object's near side in the optical frame (n, PROBES, 3)."""
    centre, half = objects.centre[near], objects.size[near].min(axis=1) / 2
    away = centre - camera[:, :2]
    along = away / np.maximum(np.hypot(*away.T), 1e-6)[:, np.newaxis]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    front = centre - along * half[:, np.newaxis]
    aside = np.stack([0 * half, ASIDE * half, -ASIDE * half], axis=1)
    points = np.empty((len(near), len(LEVELS), 3, 3))
    points[..., :2] = (front[:, np.newaxis] + across[:, np.newaxis] * aside[..., np.newaxis])[:, np.newaxis]
    points[..., 2] = _levels(objects, near)[:, :, np.newaxis]
    return np.asarray((points.reshape(len(near), PROBES, 3) - camera[:, np.newaxis]) @ rotation)


def floor_levels(frames: Frames, camera: Floats, rotation: Floats) -> Floats:
    """Return how high above the map's zero is what views show in their lower part, the median (views,) in metres.

    Infinite where depth is missing there. camera, rotation: as in `look`.
    """
    column = (frames.columns[:, np.newaxis] * _LOW_COLUMNS).astype(np.intp)
    row = (frames.rows[:, np.newaxis] * _LOW_ROWS).astype(np.intp)
    cell = frames.starts[:, np.newaxis] + row * frames.columns[:, np.newaxis] + column
    depth = frames.near_mm[cell] / 1000.0
    fx, fy, cx, cy = (each[:, np.newaxis] for each in frames.lens.T)
    right, down, ahead = (each[:, np.newaxis] for each in rotation[:, 2].T)
    rise = right * (column + 0.5 - cx) / fx + down * (row + 0.5 - cy) / fy + ahead
    return np.asarray(np.median(np.where(depth > 0, camera[:, 2:] + depth * rise, np.inf), axis=1))


class FloorLevels:
    """How high above the map's zero the floor is that each camera shows in its lower part, if its view fits, in metres.

    known: by the camera's number, NaN where it is not known.
    """

    def __init__(self) -> None:
        self.known = np.zeros(0)
        self._last = np.zeros((0, FLOOR_VIEWS))

    def compare(self, cameras: Rows, floor_m: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which views show the floor where it is, and which show it too deep. floor_m: see `floor_levels`.

        It is where the camera showed it, or where most cameras do. Where no camera did, neither is known.
        """
        self._reserve(int(cameras.max(initial=-1)) + 1)
        own, all_known = self.known[cameras], self.known[np.isfinite(self.known)]
        usual = np.median(all_known) if len(all_known) else np.nan
        right = (np.abs(floor_m - own) < DEEPER_M) | (np.abs(floor_m - usual) < DEEPER_M)
        return right, floor_m < np.minimum(np.fmin(own, usual), 0.0) - DEEPER_M

    def learn(self, cameras: Rows, floor_m: Floats) -> None:
        """Learn from views that fit, one of each camera."""
        some = np.isfinite(floor_m)
        if not some.any():
            return
        cameras = cameras[some]
        self._reserve(int(cameras.max()) + 1)
        self._last[cameras] = np.column_stack([self._last[cameras, 1:], floor_m[some]])
        self.known[cameras] = np.nanmedian(self._last[cameras], axis=1)

    def forget(self, cameras: Rows) -> None:
        """Begin anew with cameras."""
        self._last[cameras[cameras < len(self.known)]] = np.nan
        self.known[cameras[cameras < len(self.known)]] = np.nan

    def restore(self, known: Sequence[float]) -> None:
        """Go on with what was known before, where nothing is."""
        self._reserve(len(known))
        self.known[: len(known)] = [each if np.isfinite(each) else np.nan for each in known]
        self._last[:] = self.known[:, np.newaxis]

    def _reserve(self, count: int) -> None:
        if count > len(self.known):
            more = np.full((count - len(self.known), FLOOR_VIEWS), np.nan)
            self.known, self._last = np.concatenate([self.known, more[:, 0]]), np.concatenate([self._last, more])


class Vocabulary:
    """Which classes each detection model gave, from all robots that run it."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}
        self._names: list[str] = []
        self._times = np.zeros((0, MAX_CLASSES), np.int64)
        self._since_ns = np.zeros(0, np.int64)

    def heed(
        self, frames: Frames, seen: Sightings, names: Sequence[str]
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Learn from views; return which classes their models gave (views, MAX_CLASSES), and since when each is known.

        seen: the views' sightings. names: of classes, by number; numbers may be another class's from then on.
        """
        if self._names != names:
            reused = [number for number, name in enumerate(self._names) if name != names[number]]
            self._times[:, reused] = 0
            self._names = list(names)
        numbers = self._of([view.model for view in frames.views], frames.at_ns)
        np.add.at(self._times, (numbers[seen.frame], seen.classes), 1)
        return self._times[numbers] >= NAMED_TIMES, self._since_ns[numbers]

    def known(self) -> dict[str, list[str]]:
        """Return the names of the classes that each model gave."""
        given = self._times >= NAMED_TIMES
        return {
            model: [name for name, has in zip(self._names, given[number].tolist(), strict=False) if has]
            for model, number in self._numbers.items()
        }

    def restore(self, known: Mapping[str, Sequence[str]], names: Sequence[str]) -> None:
        """Go on with what was known before, where nothing is. names: of classes, by number."""
        self._names = list(names)
        models = list(known)[:MOST_MODELS]
        numbers = self._of(models, np.zeros(0, np.int64)).tolist()
        for number, model in zip(numbers, models, strict=True):
            self._times[number, [names.index(each) for each in known[model] if each in names]] = NAMED_TIMES

    def set_back(self, now_ns: int) -> None:
        """Cap all times at now: the clock was set back."""
        np.minimum(self._since_ns, now_ns, out=self._since_ns)

    def _of(self, models: Sequence[str], at_ns: NDArray[np.int64]) -> Rows:
        new = dict.fromkeys(each for each in models if each not in self._numbers)
        if len(self._numbers) + len(new) > MOST_MODELS:
            new = dict.fromkeys(models)
            self._numbers.clear()
            self._times, self._since_ns = self._times[:0], self._since_ns[:0]
        if new:
            self._numbers.update({name: len(self._numbers) + nth for nth, name in enumerate(new)})
            self._times = np.concatenate([self._times, np.zeros((len(new), MAX_CLASSES), np.int64)])
            self._since_ns = np.concatenate([self._since_ns, np.full(len(new), at_ns.max(initial=0))])
        return np.array([self._numbers[name] for name in models], np.intp)
