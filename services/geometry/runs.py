"""COCO's run-length encoding of masks: text to runs of set pixels, of many masks at once. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.geometry.errors import MaskError

Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]

_FIRST: Final = np.uint8(ord("0"))
_BITS: Final = 5
_VALUE: Final = 0x1F
_MORE: Final = 0x20
_SIGN: Final = 0x10
_SIGN_PLACE: Final = 4
_LONGEST: Final = 7
"""Characters of the longest number that fits an image."""


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Runs of set pixels of n masks, that go down the columns: in pictures of `height` rows side by side.

    starts, stops: a pixel's number in column order, none of them empty. bounds: (n + 1,) which runs are whose.
    """

    height: int
    starts: Integers
    stops: Integers
    bounds: NDArray[np.intp]

    @classmethod
    def of(cls, texts: Sequence[str], height: int, width: int) -> "Runs":
        """Decode masks of height x width.

        Raises:
            MaskError: the runs of one are damaged, or do not fill its image.
        """
        lengths, ends = _lengths(texts)
        size = height * width
        stops = np.cumsum(lengths)
        if lengths.max() > size or (stops[ends - 1] != size * np.arange(1, len(ends) + 1)).any():
            raise MaskError(f"runs of {sum(lengths.tolist())} pixels, the mask has {size}")
        first = ends - np.diff(ends, prepend=0)
        is_set = ((np.arange(len(lengths)) - first.repeat(ends - first)) & 1).astype(np.bool_)
        chosen = np.flatnonzero(is_set & (lengths > 0))
        stops = stops[chosen]
        bounds = np.searchsorted(chosen, np.concatenate([first[:1], ends]))
        return cls(height, stops - lengths[chosen], stops, bounds)

    def pixels(self, lefts: Integers, rights: Integers) -> Bools:
        """Return whether pixels are set: of each mask those from column `left` to before `right`, in column order.

        lefts, rights: (n,) columns of the pictures side by side, in which all runs are.
        """
        count, of = len(lefts), np.arange(len(lefts))
        whose = of.repeat(np.diff(self.bounds))
        lengths = np.zeros(2 * len(self.starts) + count, np.int64)
        at = 2 * np.arange(len(self.starts)) + whose
        before = np.concatenate([[0], self.stops[:-1]])
        some = np.diff(self.bounds) > 0
        before[self.bounds[:-1][some]] = lefts[some] * self.height
        lengths[at], lengths[at + 1] = self.starts - before, self.stops - self.starts
        last = self.stops[self.bounds[1:][some] - 1]
        lengths[(2 * self.bounds[1:] + of)[some]] = rights[some] * self.height - last
        flags = np.zeros(len(lengths), np.bool_)
        flags[at + 1] = True
        return flags.repeat(lengths)


def _lengths(texts: Sequence[str]) -> tuple[Integers, NDArray[np.intp]]:
    """Return the lengths of the runs, of clear and set pixels in turn, clear ones first, and where each text's end.

    Raises:
        MaskError: they are not encoded as COCO does it.
    """
    try:
        codes = np.frombuffer("".join(texts).encode("ascii"), np.uint8) - _FIRST
    except UnicodeEncodeError as error:
        raise MaskError("runs that are not ASCII text") from error
    last = (codes & _MORE) == 0
    text_ends = np.cumsum([len(text) for text in texts])
    if not all(texts) or codes.max() > _VALUE + _MORE or not last[text_ends - 1].all():
        raise MaskError("runs that are not encoded as COCO does it")
    ends = np.flatnonzero(last) + 1
    first = np.zeros_like(ends)
    first[1:] = ends[:-1]
    sizes = ends - first
    if sizes.max() > _LONGEST:
        raise MaskError("a run longer than any image")
    places = np.arange(len(codes)) - first.repeat(sizes)
    numbers = np.add.reduceat((codes & _VALUE).astype(np.int64) << _BITS * places, first)
    numbers -= (codes[ends - 1] & _SIGN).astype(np.int64) << _BITS * sizes >> _SIGN_PLACE
    bounds = np.searchsorted(ends, text_ends) + 1
    for start, end in zip([0, *bounds[:-1].tolist()], bounds.tolist(), strict=True):
        for changes in (numbers[start + 1 : end : 2], numbers[start + 2 : end : 2]):
            changes.cumsum(out=changes)  # from the fourth on each is what it is more than the last but one
    if numbers.min() < 0:
        raise MaskError("a run of less than no pixels")
    return numbers, bounds
