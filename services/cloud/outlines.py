"""Selects the points of a cloud that lie in an object's mask in the camera's image. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Protocol, Self

import cv2
import numpy as np

from services.cloud.points import Bytes, Floats, Indices, Points, some, usable
from services.geometry.foreground import WELL_READ, has_own_depth
from services.geometry.masks import Window, eroded, surroundings

NEAR_M: Final = 0.05
"""Nearer points belong to the camera's own housing, or are no readings."""

EDGE: Final = 1
"""Untrusted pixels at the edge of a mask: they mix two surfaces, or the edge is wrong."""

SOLID: Final = 0.6
"""A mask keeps its edge if less than this share of its pixels would remain without it."""

RING: Final = 5
"""Width in pixels of the surroundings of a mask, which show what is behind and before the object."""

AROUND: Final = 512
"""Maximum number of these pixels."""

MEASURED: Final = 256
"""Number of points, up to twice as many, from which an object's width is estimated."""

AT_ONCE: Final = 1 << 18
"""Number of points of objects read at once, unless a single object has more."""


def trusted(window: Window) -> Window:
    """Return a mask without its edge, unless it is mostly edge."""
    inner = eroded(window, EDGE)
    return inner if inner.area >= SOLID * window.area else window


@dataclass(frozen=True, slots=True, eq=False)
class Masked:
    """An object in the image. mask: its pixels; inner: the trusted part of them, in the same window."""

    mask: Window
    inner: Window

    @classmethod
    def of(cls, mask: Window) -> Self:
        """Make the outline of a mask, with its edge removed."""
        return cls(mask, trusted(mask))

    def around(self, height: int, width: int) -> Window:
        """Return the pixels of an image of this size that are within RING of the mask, but not in it."""
        window = self.widened(height, width)
        return Window(window.top, window.left, surroundings(window, RING))

    def widened(self, height: int, width: int) -> Window:
        """Return the mask in a window with a margin of RING pixels, clipped to an image of this size."""
        (top, left), (rows, columns) = (self.mask.top, self.mask.left), self.mask.pixels.shape
        above, before = min(RING, top), min(RING, left)
        below, behind = min(RING, height - top - rows), min(RING, width - left - columns)
        wide = cv2.copyMakeBorder(
            self.mask.pixels.view(np.uint8), above, below, before, behind, cv2.BORDER_CONSTANT, value=0
        )
        return Window(top - above, left - before, wide.view(np.bool_))


@dataclass(frozen=True, slots=True, eq=False)
class Cutout:
    """Some points of a cloud: indices, coordinates (3, n) in its frame, and colours (n, 3) if it has any."""

    at: Indices
    xyz: Floats
    rgb: Bytes | None

    def only(self, which: Indices) -> "Cutout":
        """Return a selection of the points."""
        rgb = None if self.rgb is None else self.rgb.take(which, axis=0)
        return Cutout(self.at.take(which), self.xyz.take(which, axis=1), rgb)


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Points covered by a mask; some of them belong to the object.

    depth: n metres along the camera's view, above 0. width: of them in the picture, in metres at 1 m. around: such
    depths just outside of the mask; NaN and 0 are none. own: whether any of them are the object's.
    """

    points: Cutout
    depth: Floats
    width: float
    around: Floats
    own: bool = True


class CloudView(Protocol):
    """A cloud seen from the camera."""

    def within(self, masks: Sequence[Masked]) -> Iterator[Candidates]:
        """Return the points that the camera sees within each mask, and around it."""


@dataclass(frozen=True, slots=True)
class RegisteredView:
    """A cloud with one point per pixel, or per block of `factor` x `factor` pixels."""

    points: Points
    factor: int = 1

    def within(self, masks: Sequence[Masked]) -> Iterator[Candidates]:
        """See `CloudView.within`."""
        height, width = (self.factor * side for side in self.points.shape)
        group: list[tuple[Masked, Indices, Indices]] = []
        for each in masks:
            group.append((each, self._numbers(each.inner), self._numbers(each.around(height, width), AROUND)))
            if sum(len(numbers) for _, numbers, _ in group) > AT_ONCE:
                yield from self._candidates(group)
                group = []
        if group:
            yield from self._candidates(group)

    def _numbers(self, window: Window, most: int | None = None) -> Indices:
        """Return the points of the pixels of a mask, or that many of them."""
        first = self.factor // 2
        top, left = (first - window.top) % self.factor, (first - window.left) % self.factor
        pixels = window.pixels[top :: self.factor, left :: self.factor]
        at = pixels.reshape(-1).nonzero()[0]
        if most is not None:
            at = at.take(some(len(at), most))
        width = self.points.shape[1]
        at += at // max(1, pixels.shape[1]) * (width - pixels.shape[1])
        at += (window.top + top) // self.factor * width + (window.left + left) // self.factor
        return at

    def _candidates(self, group: Sequence[tuple[Masked, Indices, Indices]]) -> Iterator[Candidates]:
        masks, numbers, outside = zip(*group, strict=True)
        at, ends = np.concatenate(numbers), np.cumsum([0, *map(len, numbers)])
        rings = np.cumsum([0, *map(len, outside)])
        around = self.points.take(np.concatenate(outside)).xyz()[2]
        xyz = self.points.take(at).xyz()
        seen = usable(xyz) & (xyz[2] > NEAR_M)
        if not seen.all():
            which = np.flatnonzero(seen)
            at, xyz, ends = at.take(which), xyz.take(which, axis=1), np.searchsorted(which, ends)
        rgb = self.points.take(at).rgb()
        widths = widths_of(xyz, ends)
        bounds = zip(masks, numbers, pairwise(ends.tolist()), pairwise(rings.tolist()), widths.tolist(), strict=True)
        for mask, every, (start, end), (first, last), width in bounds:
            found = Cutout(at[start:end], xyz[:, start:end], None if rgb is None else rgb[start:end])
            own = end - start >= WELL_READ * len(every) or self._has_own(mask)
            yield Candidates(found, found.xyz[2], width, around[first:last], own)

    def _has_own(self, mask: Masked) -> bool:
        """See `has_own_depth`; a point stands for every pixel it covers."""
        window = mask.widened(*(self.factor * side for side in self.points.shape))
        rows, columns = (np.arange(part.start, part.stop) // self.factor for part in window.place)
        xyz = self.points.take((rows[:, np.newaxis] * self.points.shape[1] + columns).reshape(-1)).xyz()
        depth = np.where(usable(xyz) & (xyz[2] > NEAR_M), xyz[2], np.nan)
        return has_own_depth(window, depth.reshape(window.pixels.shape))


def widths_of(xyz: Floats, bounds: Indices) -> Floats:
    """Return the width of n objects in the image, in metres at a distance of 1 m; 0 without points.

    bounds: (n + 1,) which of the points (3, ...) are whose.
    """
    counts = np.diff(bounds)
    widths = np.zeros(len(counts), np.float32)
    filled = np.flatnonzero(counts)
    if len(filled):
        steps = np.maximum(1, counts // MEASURED)
        chosen = [np.arange(bounds[each], bounds[each + 1], steps[each]) for each in filled.tolist()]
        x, y, z = xyz.take(np.concatenate(chosen), axis=1)
        starts = np.cumsum([0, *(len(each) for each in chosen[:-1])])
        reach = [np.maximum.reduceat(each, starts) - np.minimum.reduceat(each, starts) for each in (x / z, y / z)]
        widths[filled] = np.maximum(*reach)
    return widths


def factor_of(height: int, width: int, points: Points) -> int:
    """Return the number of image pixels per point across and down; 0 if it is not an integer."""
    rows, columns = points.shape
    if not points.is_organised or height % rows or width % columns or height // rows != width // columns:
        return 0
    return height // rows
