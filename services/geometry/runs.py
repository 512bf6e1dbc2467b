"""Decodes COCO's run-length encoding of many masks at once: text to runs of set pixels. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.geometry.errors import MaskError

Integers = NDArray[np.int64]

_FIRST: Final = ord("0")
_BITS: Final = 5
_VALUE: Final = 0x1F
_MORE: Final = 0x20
_SIGN: Final = 0x10
_LONGEST: Final = 7
"""Characters of the longest number that fits an image."""


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Runs of set pixels of n masks, down the columns, in images of `height` rows side by side.

    starts, stops: a pixel's number in column order, none of them empty. bounds: (n + 1,) which runs are whose.
    """

    height: int
    starts: Integers
    stops: Integers
    bounds: Integers

    @classmethod
    def of(cls, texts: Sequence[str], height: int, width: int) -> "Runs":
        """Decode masks of height x width.

        Raises:
            MaskError: the runs of one are damaged, or do not fill its image.
        """
        changes, ends = _changes(texts)
        begins = np.zeros_like(ends)
        begins[1:] = ends[:-1]
        counts = ends - begins
        odd = (np.arange(len(changes)) - begins.repeat(counts)) & 1
        lengths = _lengths(changes, begins, counts, odd)
        size = height * width
        stops = lengths.cumsum()
        if lengths.max() > size or (stops[ends - 1] != size * np.arange(1, len(ends) + 1)).any():
            raise MaskError(f"runs of {sum(lengths.tolist())} pixels, the mask has {size}")
        chosen = (lengths * odd).nonzero()[0]
        bounds = np.zeros(len(ends) + 1, np.int64)
        bounds[1:] = chosen.searchsorted(ends)
        stops = stops[chosen]
        return cls(height, stops - lengths[chosen], stops, bounds)


def _changes(texts: Sequence[str]) -> tuple[Integers, Integers]:
    """Return the numbers in texts, and where each text's numbers end.

    Raises:
        MaskError: they are not encoded as COCO does it.
    """
    try:
        codes = np.frombuffer("".join(texts).encode("ascii"), np.uint8) - np.uint8(_FIRST)
    except UnicodeEncodeError as error:
        raise MaskError("runs that are not ASCII text") from error
    last = codes < _MORE
    text_ends = np.cumsum([len(text) for text in texts])
    if not all(texts) or codes.max() >= 2 * _MORE or not last[text_ends - 1].all():
        raise MaskError("runs that are not encoded as COCO does it")
    ends = last.nonzero()[0]
    sizes = ends + 1
    sizes[1:] -= sizes[:-1].copy()
    longest = int(sizes.max())
    if longest > _LONGEST:
        raise MaskError("a run longer than any image")
    numbers = (codes[ends].astype(np.int64) ^ _SIGN) - _SIGN
    for place in range(1, longest):
        longer = (sizes > place).nonzero()[0]
        numbers[longer] = (numbers[longer] << _BITS) | (codes[ends[longer] - place] & _VALUE)
    return numbers, ends.searchsorted(text_ends)


def _lengths(changes: Integers, begins: Integers, counts: Integers, odd: Integers) -> Integers:
    """Return the alternating lengths of clear and set runs: from a text's fourth on, each is a difference.

    Raises:
        MaskError: one is negative.
    """
    sums = np.zeros(len(changes) + 1, np.int64)  # the last one is what is before the first
    sums[:-1] = changes
    sums[begins] = 0
    for each in (sums[:-1:2], sums[1:-1:2]):
        each.cumsum(out=each)
    before, more = sums[begins], sums[begins - 1] - sums[begins]
    lengths = sums[:-1] - before.repeat(counts) - odd * more.repeat(counts)
    lengths[begins] = changes[begins]
    if lengths.min() < 0:
        raise MaskError("a run of negative length")
    return lengths
