"""Some readings of depth in each object's mask and just around it, of all objects of an image at once. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.geometry.masks import Window, eroded, surroundings

Floats = NDArray[np.float32]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]

SAMPLE: Final = 512
"""Readings of an object that its statistics are made of, spread evenly over it."""

AROUND: Final = 256
"""Readings around it."""

FILLED: Final = SAMPLE // 8
"""Where fewer pixels than this have a reading near, of SAMPLE, those that have one are taken."""

REACH: Final = 2
"""A pixel without a reading counts as the nearest one of its row that has one, at most so many pixels away."""

RING: Final = 5
"""Pixels around a mask that say what is behind and before the object."""

_NUMBER_BITS: Final = np.uint64(32)
_EVEN: Final = {count: np.arange(count, dtype=np.float64) for count in (SAMPLE, AROUND)}
_APART: Final = {count: np.random.default_rng(0).random(count) for count in (SAMPLE, AROUND)}
"""Where in each of so many equal parts of a range: at their beginnings, all could fall on one column of a mask."""


@dataclass(frozen=True, slots=True)
class Criteria:
    """When readings count. min_pixels: valid ones that an object needs. edge: pixels taken off at a mask's edges."""

    min_pixels: int = 30
    edge: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Picked:
    """What n masks hold: areas, counts: (n,) pixels, and how many of them have a reading. mean_m: (n,) of these.

    rows: which ones have enough readings, m of them. z: (m, SAMPLE) some of these in metres, ascending. at: (m, SAMPLE)
    flat places of these in the image. around: (m, AROUND) readings around them, ascending, NaN where there are none.
    """

    areas: Indices
    counts: Indices
    mean_m: NDArray[Any]
    rows: Indices
    z: Floats
    at: Indices
    around: Floats


def pick(windows: Sequence[Window], depth_m: Floats, criteria: Criteria) -> Picked:
    """Pick readings of depth, height x width, NaN for none, in windows with a margin of RING."""
    offsets = np.concatenate([[0], np.cumsum([window.pixels.size for window in windows])])
    depth = np.empty(offsets[-1], np.float32)
    for window, start, end in zip(windows, offsets[:-1], offsets[1:], strict=True):
        depth[start:end].reshape(window.pixels.shape)[:] = depth_m[window.place]
    there = depth > 0
    masked = _Marked.of(windows, offsets, there)
    rows = np.flatnonzero(masked.counts >= criteria.min_pixels)
    core = _Marked.of(list(_cores(windows, offsets, there, criteria)), offsets, there) if criteria.edge else masked
    within = core.nearest(rows)
    at = _in_image(within, [windows[row] for row in rows.tolist()], offsets[rows], depth_m.shape[1])
    z, at = _ascending(depth.take(within), at)
    around = _around(windows, rows, depth, there, offsets)
    return Picked(masked.areas, masked.counts, masked.means(depth), rows, z, at, around)


@dataclass(frozen=True, slots=True, eq=False)
class _Marked:
    """Pixels of n windows, one window after another. at: which are marked. inner: which of these have a reading.

    bounds: (n + 1,) whose marked pixels are which. read: (len(at) + 1,) how many with a reading are before each.
    """

    at: Indices
    inner: Indices
    bounds: Indices
    read: Indices

    @classmethod
    def of(cls, windows: Sequence[Window], offsets: Indices, there: Bools) -> "_Marked":
        pixels = np.concatenate([window.pixels.reshape(-1) for window in windows])
        at = pixels.nonzero()[0]
        read = np.zeros(len(at) + 1, np.intp)
        there.take(at).cumsum(out=read[1:])
        inner = at if read[-1] == len(at) else (pixels & there).nonzero()[0]
        return cls(at, inner, np.searchsorted(at, offsets), read)

    @property
    def areas(self) -> Indices:
        return np.diff(self.bounds)

    @property
    def counts(self) -> Indices:
        return np.diff(self.read[self.bounds])

    def means(self, depth: Floats) -> NDArray[Any]:
        """Return the mean depth of each window's readings, 0 where there are none."""
        values = depth.take(self.inner).astype(np.float64)
        means = np.zeros(len(self.counts))
        some = np.flatnonzero(self.counts)
        if len(some):
            means[some] = np.add.reduceat(values, self.read[self.bounds[some]]) / self.counts[some]
        return means

    def nearest(self, rows: Indices) -> Indices:
        """Return SAMPLE pixels with readings of each of these windows, instead of some that may have none.

        Readings are lost at edges and in shadows: without those beside them what is there would not count.
        """
        inner, wanted = self.inner, _spread(self.bounds[rows], self.areas[rows], SAMPLE)
        if inner is self.at:
            return inner.take(wanted)
        after, wanted = self.read.take(wanted), self.at.take(wanted)
        first, last = (self.read[self.bounds[rows + end]][:, np.newaxis] for end in (0, 1))
        nexts, lasts = inner.take(np.minimum(after, last - 1)), inner.take(np.maximum(after - 1, first))
        to_next, to_last = np.abs(nexts - wanted), np.abs(wanted - lasts)
        near = np.minimum(to_next, to_last) <= REACH
        found = np.where(to_next <= to_last, nexts, lasts)[near]
        counts = near.sum(axis=1)
        starts = counts.cumsum() - counts
        if (few := counts < FILLED).any():
            starts = np.where(few, len(found) + first[:, 0], starts)
            counts = np.where(few, (last - first)[:, 0], counts)
            found = np.concatenate([found, inner])
        return np.asarray(found.take(_spread(starts, counts, SAMPLE)))


def _cores(windows: Sequence[Window], offsets: Indices, there: Bools, criteria: Criteria) -> Iterator[Window]:
    """Return masks without their edges, where that leaves enough readings."""
    for window, start in zip(windows, offsets, strict=False):
        inner = eroded(window, criteria.edge)
        read = np.count_nonzero(inner.pixels.reshape(-1) & there[start : start + inner.pixels.size])
        yield inner if read >= criteria.min_pixels else window


def _around(windows: Sequence[Window], rows: Indices, depth: Floats, there: Bools, offsets: Indices) -> Floats:
    ring = np.zeros(len(depth), np.bool_)
    for row in rows.tolist():
        ring[offsets[row] : offsets[row + 1]] = surroundings(windows[row], RING).reshape(-1)
    at = (ring & there).nonzero()[0]
    bounds = np.searchsorted(at, offsets)
    starts, counts = bounds[rows], np.diff(bounds)[rows]
    around = np.full((len(rows), AROUND), np.nan, np.float32)
    some = counts > 0
    around[some] = depth.take(at.take(_spread(starts[some], counts[some], AROUND)))
    around.sort(axis=1)
    return around


def _spread(starts: Indices, counts: Indices, wanted: int) -> Indices:
    """Return so many numbers of each range, (n, wanted), one of each equal part of it."""
    parts = (counts / wanted)[:, np.newaxis]
    places = _EVEN[wanted] * parts + _APART[wanted] * np.maximum(parts - 1, 0)
    return starts[:, np.newaxis] + places.astype(np.intp)


def _in_image(pixels: Indices, windows: Sequence[Window], starts: Indices, width: int) -> Indices:
    """Return where in a flat image so wide pixels are, (m, k), that are counted from m windows' starts."""
    places = np.array([(window.top, window.left, window.pixels.shape[1]) for window in windows], np.intp)
    top, left, across = places.reshape(-1, 3).T[:, :, np.newaxis]
    inside = pixels - starts[:, np.newaxis]
    return np.asarray(inside + inside // across * (width - across) + (top * width + left))


def _ascending(z: Floats, at: Indices) -> tuple[Floats, Indices]:
    """Return each row in the order of z, which is positive: its bits are in the same order as it."""
    keys = (z.view(np.uint32).astype(np.uint64) << _NUMBER_BITS) | at.astype(np.uint64)
    keys.sort(axis=1)
    return (keys >> _NUMBER_BITS).astype(np.uint32).view(np.float32), keys.astype(np.uint32).astype(np.intp)
