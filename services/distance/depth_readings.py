"""Samples depth readings in and around the masks of all objects of an image at once. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.geometry.depth import Depth
from services.geometry.foreground import WELL_READ, has_own_depth
from services.geometry.masks import Window, eroded, surroundings

Floats = NDArray[np.float32]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]

SAMPLE: Final = 512
"""Number of readings of an object for its statistics, spread evenly over it."""

AROUND: Final = 256
"""Number of readings around it."""

FILLED: Final = SAMPLE // 8
"""If fewer of the SAMPLE pixels than this have a reading nearby, pixels with readings are sampled instead."""

REACH: Final = 2
"""A pixel without a reading takes the nearest one in its row, at most this many pixels away."""

RING: Final = 5
"""Width in pixels of the surroundings of a mask, which show what is behind and before the object."""

_BESIDE: Final = np.array([step for apart in range(1, REACH + 1) for step in (apart, -apart)])
_BETWEEN: Final = np.zeros(REACH, np.bool_)
_NUMBER_BITS: Final = np.uint64(32)
_EVEN: Final = {count: np.arange(count, dtype=np.float64) for count in (SAMPLE, AROUND)}
_APART: Final = {count: np.random.default_rng(0).random(count) for count in (SAMPLE, AROUND)}
"""Position within each equal part of a range: at the beginnings, all could fall on one column of a mask."""

_GOLDEN: Final = (1 + 5**0.5) / 2
_ACROSS: Final = (np.arange(SAMPLE) - (SAMPLE - 1) / 2) * _GOLDEN % 1
"""Position of each reading across a line of a mask: central on average, and any few consecutive ones are evenly spaced
(Weyl, 1916)."""


@dataclass(frozen=True, slots=True)
class Criteria:
    """Criteria for readings. min_pixels: valid ones per object. edge: pixels trimmed from a mask's edges."""

    min_pixels: int = 30
    edge: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Picked:
    """Readings of n masks. areas, counts: (n,) pixels, and pixels with a reading. mean_m: (n,) of these.

    own: (n,) whether any of these are the object's. rows: which ones have enough, and of their own, m of them.
    z: (m, SAMPLE) some of these in metres, ascending. at: (m, SAMPLE) flat places of these in the image. around:
    (m, AROUND) readings around them, ascending, NaN where there are none.
    """

    areas: Indices
    counts: Indices
    mean_m: NDArray[Any]
    own: Bools
    rows: Indices
    z: Floats
    at: Indices
    around: Floats


def pick(windows: Sequence[Window], image: Depth, criteria: Criteria) -> Picked:
    """Samples readings of a depth image in windows with a margin of RING."""
    starts = np.cumsum([0, *(window.pixels.size + REACH for window in windows)])
    depth = np.zeros(starts[-1], np.float32)
    for window, start in zip(windows, starts.tolist(), strict=False):
        depth[start : start + window.pixels.size].reshape(window.pixels.shape)[:] = image.metres(window.place)
    there = depth > 0
    masked = _Marked.of(windows, starts, there)
    counts, means = masked.means(depth)
    stands_for = np.array([window.step**2 for window in windows], np.intp)
    areas, counts = masked.areas * stands_for, counts * stands_for
    enough = counts >= criteria.min_pixels
    own = np.ones(len(windows), np.bool_)
    for row in np.flatnonzero(enough & (counts < WELL_READ * areas)).tolist():
        window = windows[row]
        end = starts[row] + window.pixels.size
        own[row] = has_own_depth(window, depth[starts[row] : end].reshape(window.pixels.shape))
    rows = np.flatnonzero(enough & own)
    core = _Marked.of(list(_cores(windows, starts, there, criteria)), starts, there) if criteria.edge else masked
    within = core.nearest(rows)
    at = _in_image(within, [windows[row] for row in rows.tolist()], starts[rows], image.shape[1])
    z, at = _ascending(depth.take(within), at)
    around = _around(windows, rows, depth, there, starts)
    return Picked(areas, counts, means, own, rows, z, at, around)


@dataclass(frozen=True, slots=True, eq=False)
class _Marked:
    """Pixels of n windows, one window after another, REACH pixels apart to keep them from affecting each other.

    starts: (n + 1,) where windows begin. at: which pixels are marked. bounds: (n + 1,) whose these are. ends: how many
    there are up to the end of each line of each window. read: of every pixel, whether it is marked and has a reading.
    """

    starts: Indices
    at: Indices
    bounds: Indices
    ends: Indices
    read: Bools

    @classmethod
    def of(cls, windows: Sequence[Window], starts: Indices, there: Bools) -> "_Marked":
        pixels = np.concatenate([part for window in windows for part in (window.pixels.reshape(-1), _BETWEEN)])
        at = pixels.nonzero()[0]
        shapes = [window.pixels.shape for window in windows]
        lines = [start + width * np.arange(1, high + 1) for (high, width), start in zip(shapes, starts, strict=False)]
        ends = np.searchsorted(at, np.concatenate(lines))
        return cls(starts, at, np.searchsorted(at, starts), ends, pixels & there)

    @property
    def areas(self) -> Indices:
        return np.diff(self.bounds)

    def means(self, depth: Floats) -> tuple[Indices, NDArray[Any]]:
        """Return the number of readings of each window, and their mean, 0 where there are none."""
        readings = [depth[start:end][self.read[start:end]] for start, end in pairwise(self.starts.tolist())]
        counts = np.array([len(each) for each in readings], np.intp)
        return counts, np.array([cv2.mean(each)[0] if len(each) else 0.0 for each in readings])

    def nearest(self, rows: Indices) -> Indices:
        """Return SAMPLE pixels with readings of each of these windows, in place of samples that may have none.

        Readings are lost at edges and in shadows: without those beside them what is there would not count.
        """
        wanted = self.at.take(self._scattered(rows))
        near = self.read.take(wanted)
        lost = np.nonzero(~near)
        beside = wanted[lost][:, np.newaxis] + _BESIDE
        met = self.read.take(beside, mode="clip")
        wanted[lost] = beside[np.arange(len(beside)), met.argmax(axis=1)]
        near[lost] = met.any(axis=1)
        found, counts = wanted[near], near.sum(axis=1)
        begins = counts.cumsum() - counts
        for row in np.flatnonzero(counts < FILLED).tolist():
            start, end = self.starts[rows[row] : rows[row] + 2]
            every = start + np.flatnonzero(self.read[start:end])
            begins[row], counts[row] = len(found), len(every)
            found = np.concatenate([found, every])
        return np.asarray(found.take(_spread(begins, counts, SAMPLE)))

    def _scattered(self, rows: Indices) -> Indices:
        """Return SAMPLE of the marked pixels of each window, spread over it as evenly as possible.

        An equal part of a wide mask is longer than a line: within it, any place across would be as good as another.
        """
        counts = self.areas[rows][:, np.newaxis]
        numbers = self.bounds[rows][:, np.newaxis] + ((_EVEN[SAMPLE] + 0.5) * (counts / SAMPLE)).astype(np.intp)
        lines = np.searchsorted(self.ends, numbers, side="right")
        wide = np.diff(self.ends, prepend=0).take(lines)
        across = self.ends.take(lines) - wide + (_ACROSS * wide).astype(np.intp)
        return np.where(counts > SAMPLE, across, numbers)


def _cores(windows: Sequence[Window], starts: Indices, there: Bools, criteria: Criteria) -> Iterator[Window]:
    """Return masks without their edges, where enough readings remain."""
    for window, start in zip(windows, starts, strict=False):
        inner = eroded(window, criteria.edge)
        read = np.count_nonzero(inner.pixels.reshape(-1) & there[start : start + inner.pixels.size])
        yield inner if read >= criteria.min_pixels else window


def _around(windows: Sequence[Window], rows: Indices, depth: Floats, there: Bools, starts: Indices) -> Floats:
    ring = np.zeros(len(depth), np.bool_)
    for row in rows.tolist():
        ring[starts[row] : starts[row] + windows[row].pixels.size] = surroundings(windows[row], RING).reshape(-1)
    at = (ring & there).nonzero()[0]
    bounds = np.searchsorted(at, starts)
    begins, counts = bounds[rows], np.diff(bounds)[rows]
    around = np.full((len(rows), AROUND), np.nan, np.float32)
    some = counts > 0
    around[some] = depth.take(at.take(_spread(begins[some], counts[some], AROUND)))
    around.sort(axis=1)
    return around


def _spread(starts: Indices, counts: Indices, wanted: int) -> Indices:
    """Return random numbers of each range, (n, wanted), one from each equal part of it."""
    parts = (counts / wanted)[:, np.newaxis]
    places = _EVEN[wanted] * parts + _APART[wanted] * np.maximum(parts - 1, 0)
    return starts[:, np.newaxis] + places.astype(np.intp)


def _in_image(pixels: Indices, windows: Sequence[Window], starts: Indices, width: int) -> Indices:
    """Return the flat indices (m, k) in an image of this width of pixels counted from m windows' starts."""
    places = np.array([(each.top, each.left, each.pixels.shape[1], each.step) for each in windows], np.intp)
    top, left, across, step = places.reshape(-1, 4).T[:, :, np.newaxis]
    rows, columns = np.divmod(pixels - starts[:, np.newaxis], across)
    return np.asarray((top + rows * step) * width + left + columns * step)


def _ascending(z: Floats, at: Indices) -> tuple[Floats, Indices]:
    """Return each row sorted by z, which is positive: its bit pattern has the same order."""
    keys = (z.view(np.uint32).astype(np.uint64) << _NUMBER_BITS) | at.astype(np.uint64)
    keys.sort(axis=1)
    return (keys >> _NUMBER_BITS).astype(np.uint32).view(np.float32), keys.astype(np.uint32).astype(np.intp)
