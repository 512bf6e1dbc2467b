"""Linear interpolation along one axis, from places in a model's output to pixels of the image. Pure."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.detector.runtime.letterbox import Axis

Floats = NDArray[np.float32]

KEPT: Final = 16
"""Axes whose taps are remembered: images of a few sizes come over and over."""


@dataclass(frozen=True, slots=True, eq=False)
class Taps:
    """Pixel n is `share` of the way from the place `before` to the next one."""

    before: NDArray[np.int64]
    share: Floats

    @classmethod
    def of(cls, axis: Axis, size: int) -> "Taps":
        """Find all of the image's pixels among `size` places; the image's padding has no say."""
        return _taps(axis, size)

    @classmethod
    def within(cls, axis: Axis, first: int, last: int, size: int) -> "tuple[int, Taps]":
        """Find the image's pixels that lie between two places of the model's input among `size` places of that window.

        Also return the first of these pixels.
        """
        ratio = axis.image / axis.content
        begin, end = (
            min(max(math.ceil((place - axis.before) * ratio - 0.5), 0), axis.image) for place in (first, last)
        )
        inputs = (np.arange(begin, end) + 0.5) / ratio + axis.before
        places = np.clip((inputs - first) * (size / (last - first)) - 0.5, 0, size - 1)
        before = places.astype(np.int64)
        return begin, cls(before, (places - before).astype(np.float32)[:, None])

    def cut(self, begin: int, end: int) -> tuple[slice, "Taps"]:
        """Return which places the pixels from `begin` to `end` need, and the taps of those pixels among them."""
        before = self.before[begin:end]
        first, last = (int(before[0]), int(before[-1]) + 2) if len(before) else (0, 1)
        return slice(first, last), Taps(before - first, self.share[begin:end])

    def apply(self, places: Floats) -> Floats:
        """Interpolate rows of places: one row per pixel. After the last place there is nothing but that place again."""
        steps = np.zeros_like(places)
        np.subtract(places[1:], places[:-1], out=steps[:-1])
        values = np.take(steps, self.before, axis=0)
        values *= self.share
        values += np.take(places, self.before, axis=0)
        return values


@lru_cache(KEPT)
def _taps(axis: Axis, size: int) -> Taps:
    ratio = size / axis.input
    low = axis.before * ratio
    high = max(low, low + axis.content * ratio - 1)
    pixels = np.arange(axis.image) + 0.5
    places = np.clip(low + pixels * (axis.content * ratio / axis.image) - 0.5, low, min(high, size - 1))
    before = places.astype(np.int64)
    return Taps(before, (places - before).astype(np.float32)[:, None])
