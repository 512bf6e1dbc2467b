"""Encodes binary masks as COCO run-length encoding, in column order of the whole image. Pure."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Mask
from services.detector.runtime.letterbox import Axis
from services.geometry.masks import Window

Integers = NDArray[np.int64]

MANY_PIXELS: Final = 1 << 22
"""Windows of more pixels than these together are not encoded at once."""

_SHIFTS: Final = np.arange(0, 35, 5)
"""Where the groups of five bits begin in a number of at most 35."""


def encode_all(windows: Iterable[Window], height: int, width: int) -> Iterator[Mask]:
    """Encode masks of an image of height x width from their windows, several at a time; outside of those they are 0."""
    for group in _groups(windows):
        yield from (Mask((height, width), text) for text in _encoded(group, height, width))


def _groups(windows: Iterable[Window]) -> Iterator[list[Window]]:
    """Return groups of windows that are small enough to be encoded in little memory."""
    group: list[Window] = []
    pixels = 0
    for window in windows:
        pixels += window.pixels.size
        if group and pixels > MANY_PIXELS:
            yield group
            group, pixels = [], window.pixels.size
        group.append(window)
    if group:
        yield group


def _encoded(windows: Sequence[Window], height: int, width: int) -> list[str]:
    edges, whose = _edges(windows, height)
    edges, whose = _merged(edges, whose)
    counts, firsts = _counts(edges, whose, len(windows), height * width)
    return _texts(counts, firsts)


def _edges(windows: Sequence[Window], height: int) -> tuple[Integers, Integers]:
    """Return the begin and end of the runs of ones in the image, and their window; no run spans two columns."""
    highs = np.array([window.pixels.shape[0] for window in windows]) + 1
    sizes = np.array([window.pixels.shape[1] for window in windows]) * highs
    starts = np.cumsum(sizes) - sizes
    padded = np.zeros(sizes.sum() + 1, np.bool_)  # each window's columns, a zero before each
    for window, start, size, high in zip(windows, starts.tolist(), sizes.tolist(), highs.tolist(), strict=True):
        padded[start : start + size].reshape(-1, high)[:, 1:] = window.pixels.T
    places = np.flatnonzero(padded[1:] != padded[:-1])  # before a change
    whose = np.searchsorted(starts, places, side="right") - 1
    across, down = np.divmod(places - starts[whose], highs[whose])
    lefts = np.array([window.left for window in windows])
    tops = np.array([window.top for window in windows])
    return (lefts[whose] + across) * height + tops[whose] + down, whose


def _merged(edges: Integers, whose: Integers) -> tuple[Integers, Integers]:
    """Join adjacent runs of a window."""
    apart = np.ones(len(edges), np.bool_)
    apart[1:-1:2] = apart[2::2] = (edges[1:-1:2] != edges[2::2]) | (whose[1:-1:2] != whose[2::2])
    return edges[apart], whose[apart]


def _counts(edges: Integers, whose: Integers, masks: int, size: int) -> tuple[Integers, Integers]:
    """Return the lengths of runs of zeros and ones in masks of `size` pixels, zeros first, and each mask's first."""
    of = np.arange(masks)
    borders = np.searchsorted(whose, of, side="right") + of
    line = np.empty(len(edges) + masks, np.int64)  # where values change, all masks one after the other
    line[np.arange(len(edges)) + whose] = edges + whose * size
    line[borders] = (of + 1) * size
    counts = np.diff(line, prepend=0)
    kept = np.ones(len(counts), np.bool_)
    kept[borders] = counts[borders] > 0
    ends = np.cumsum(kept)[borders]
    return counts[kept], np.concatenate([[0], ends[:-1]])


def _texts(counts: Integers, firsts: Integers) -> list[str]:
    """Write the counts of each mask as COCO does: from the fourth on as differences to the last but one."""
    numbers = counts.copy()
    numbers[2:] -= counts[:-2]
    ends = np.append(firsts[1:], len(counts))
    for place in range(3):
        heads = firsts[firsts + place < ends] + place
        numbers[heads] = counts[heads]
    text, lengths = _letters(numbers)
    stops = np.cumsum(lengths)[ends - 1].tolist()
    return [text[start:stop] for start, stop in zip([0, *stops], stops, strict=False)]


def _letters(numbers: Integers) -> tuple[str, NDArray[np.intp]]:
    """Write numbers in groups of five bits; also return the number of characters of each."""
    groups = numbers[:, None] >> _SHIFTS
    low = groups & 0x1F
    rest = groups >> 5
    more = rest != np.where(low & 0x10, -1, 0)
    written = np.ones_like(more)
    np.logical_and.accumulate(more[:, :-1], axis=1, out=written[:, 1:])
    letters = (low | (more << 5)) + ord("0")
    return str(letters[written].astype(np.uint8).tobytes(), "ascii"), np.count_nonzero(written, axis=1)


Floats = NDArray[np.float32]

KEPT: Final = 16
"""Axes whose taps are remembered: images of a few sizes come over and over."""


@dataclass(frozen=True, slots=True, eq=False)
class Taps:
    """Interpolation weights: pixel n is `share` of the way from the place `before` to the next one."""

    before: NDArray[np.int64]
    share: Floats

    @classmethod
    def of(cls, axis: Axis, size: int) -> "Taps":
        """Compute the taps of all pixels of the image among `size` places; its padding is ignored."""
        return _taps(axis, size)

    @classmethod
    def within(cls, axis: Axis, first: int, last: int, size: int) -> "tuple[int, Taps]":
        """Compute the taps of the image's pixels between two places of the model's input, among `size` places of it.

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
        """Return the places that the pixels from `begin` to `end` need, and the taps of these pixels among them."""
        before = self.before[begin:end]
        first, last = (int(before[0]), int(before[-1]) + 2) if len(before) else (0, 1)
        return slice(first, last), Taps(before - first, self.share[begin:end])

    def apply(self, places: Floats) -> Floats:
        """Interpolate rows of places: one row per pixel. The last place is repeated beyond the end."""
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
