"""What a camera's picture shows an object in, and which points of a cloud that is. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from services.cloud.points import Floats, Indices, Points, usable
from services.geometry.masks import Window, eroded

NEAR_M: Final = 0.05
"""Points nearer to the camera than this are of its own housing, or no readings."""

EDGE: Final = 1
"""Pixels at the edge of a mask that are not trusted: two surfaces are mixed there, or it is the wrong one."""

SOLID: Final = 0.6
"""A mask that would lose more than the rest of its pixels with its edge keeps it."""


AT_ONCE: Final = 1 << 18
"""So many points of objects are read at once, or those of one more object."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Points that a mask covers, as numbers in their cloud; some of them are the object's.

    xyz: (3, n) in the points' own frame. depth: n metres along the camera's view, above 0. across: (2, n) metres across
    it.
    """

    at: Indices
    xyz: Floats
    depth: Floats
    across: Floats


class View(Protocol):
    """A cloud as the camera sees it."""

    def within(self, windows: Sequence[Window]) -> Iterator[Candidates]:
        """Return the points that the camera sees within each mask."""


def trusted(window: Window) -> Window:
    """Return a mask without its edge, unless it is mostly edge."""
    inner = eroded(window, EDGE)
    return inner if inner.area >= SOLID * window.area else window


@dataclass(frozen=True, slots=True)
class RegisteredView:
    """A cloud with a point for each pixel, or for one of every `factor` x `factor` pixels."""

    points: Points
    factor: int = 1

    def within(self, windows: Sequence[Window]) -> Iterator[Candidates]:
        """See `View.within`."""
        group: list[Indices] = []
        for window in windows:
            group.append(self._numbers(window))
            if sum(map(len, group)) > AT_ONCE:
                yield from self._candidates(group)
                group = []
        if group:
            yield from self._candidates(group)

    def _numbers(self, window: Window) -> Indices:
        """Return which points are of the pixels of a mask."""
        first = self.factor // 2
        top, left = (first - window.top) % self.factor, (first - window.left) % self.factor
        pixels = window.pixels[top :: self.factor, left :: self.factor]
        at = np.flatnonzero(pixels)
        width = self.points.shape[1]
        at += at // max(1, pixels.shape[1]) * (width - pixels.shape[1])
        at += (window.top + top) // self.factor * width + (window.left + left) // self.factor
        return at

    def _candidates(self, group: Sequence[Indices]) -> Iterator[Candidates]:
        at, ends = np.concatenate(group), np.cumsum([len(each) for each in group])
        xyz = self.points.take(at).xyz()
        seen = usable(xyz) & (xyz[2] > NEAR_M)
        if not seen.all():
            which = np.flatnonzero(seen)
            at, xyz, ends = at.take(which), xyz.take(which, axis=1), np.searchsorted(which, ends)
        for start, end in zip([0, *ends[:-1].tolist()], ends.tolist(), strict=True):
            own = xyz[:, start:end]
            yield Candidates(at[start:end], own, own[2], own[:2])


def in_window(at: Indices, width: int, window: Window) -> Indices:
    """Return where, flat, in a window of a picture so wide its pixels `at` are."""
    across = window.pixels.shape[1]
    return np.asarray(at - at // width * (width - across) - (window.top * across + window.left))


def factor_of(height: int, width: int, points: Points) -> int:
    """Return how many pixels of a picture there are for each point across and down; 0 if they do not come out even."""
    rows, columns = points.shape
    if not points.is_organised or height % rows or width % columns or height // rows != width // columns:
        return 0
    return height // rows
