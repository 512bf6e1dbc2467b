"""Masks of objects as windows of the image: COCO run-length encoding decoded, edges taken off."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Mask
from services.geometry.errors import MaskError

Bools = NDArray[np.bool_]

_FIRST: Final = ord("0")
_BITS: Final = 5
_VALUE: Final = 0x1F
_MORE: Final = 0x20
_SIGN: Final = 0x10
_LONGEST: Final = 7
"""Characters of the longest number that fits an image."""


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A mask, cut to the rows and columns that it has pixels in. pixels: height x width.

    top, left: where in the image its first row and column are.
    """

    top: int
    left: int
    pixels: Bools

    @property
    def place(self) -> tuple[slice, slice]:
        """The rows and columns of the image that the window covers."""
        height, width = self.pixels.shape
        return slice(self.top, self.top + height), slice(self.left, self.left + width)

    @property
    def area(self) -> int:
        """How many pixels the mask has."""
        return int(np.count_nonzero(self.pixels))


def decode(mask: Mask, *, margin: int = 0) -> Window:
    """Decode a mask; an empty one is a window without pixels.

    margin: rows and columns around it that the window has too, as far as the image goes.

    Raises:
        MaskError: the runs are damaged, or do not fill the image.
    """
    height, width = mask.size
    ends = np.cumsum(_runs(mask.counts))
    if not len(ends) or ends[-1] != height * width:
        raise MaskError(f"runs of {int(ends[-1]) if len(ends) else 0} pixels, the mask has {height * width}")
    starts, stops = ends[: len(ends) - 1 : 2], ends[1::2]
    full = stops > starts
    starts, stops = starts[full], stops[full]
    if not len(starts):
        return Window(0, 0, np.zeros((0, 0), np.bool_))
    return _window(starts, stops, height, width, margin)


def _window(starts: NDArray[np.int64], stops: NDArray[np.int64], height: int, width: int, margin: int) -> Window:
    """Return the window of runs of set pixels, from `starts` to before `stops`, that go down the columns."""
    left, right = max(int(starts[0]) // height - margin, 0), min((int(stops[-1]) - 1) // height + 1 + margin, width)
    edges = np.stack([starts, stops], axis=1).ravel() - left * height
    lengths = np.diff(edges, prepend=0, append=(right - left) * height)
    flags = np.zeros(len(lengths), np.bool_)
    flags[1::2] = True
    columns = np.repeat(flags, lengths).reshape(right - left, height)
    first, last = starts % height, (stops - 1) % height
    whole = bool((starts // height != (stops - 1) // height).any())
    top, bottom = (0, height) if whole else (int(first.min()), int(last.max()) + 1)
    top, bottom = max(top - margin, 0), min(bottom + margin, height)
    return Window(top, left, np.ascontiguousarray(columns[:, top:bottom].T))


def _runs(counts: str) -> NDArray[np.int64]:
    """Return the lengths of the runs, of clear and set pixels in turn, clear ones first.

    Raises:
        MaskError: they are not encoded as COCO does it.
    """
    try:
        codes = np.frombuffer(counts.encode("ascii"), np.uint8).astype(np.int64) - _FIRST
    except UnicodeEncodeError as error:
        raise MaskError("runs that are not ASCII text") from error
    last = np.flatnonzero((codes & _MORE) == 0)
    if not len(codes) or codes.min() < 0 or codes.max() > _VALUE + _MORE or not len(last) or last[-1] + 1 != len(codes):
        raise MaskError("runs that are not encoded as COCO does it")
    first = np.concatenate([[0], last[:-1] + 1])
    lengths = last - first + 1
    if lengths.max() > _LONGEST:
        raise MaskError("a run longer than any image")
    place = np.arange(len(codes)) - np.repeat(first, lengths)
    numbers = np.add.reduceat((codes & _VALUE) << (_BITS * place), first)
    numbers -= np.where(codes[last] & _SIGN, np.int64(1) << (_BITS * lengths), 0)
    numbers[1::2] = np.cumsum(numbers[1::2])  # from the fourth on each is what it is more than the last but one
    numbers[2::2] = np.cumsum(numbers[2::2])
    if numbers.min() < 0:
        raise MaskError("a run of less than no pixels")
    return numbers


def eroded(window: Window, pixels: int) -> Window:
    """Return the mask without what is within `pixels` of its edge, in the same window."""
    if not (pixels and window.pixels.size):
        return window
    size = 2 * pixels + 1
    kernel = np.ones((size, size), np.uint8)
    inner = cv2.erode(window.pixels.view(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return Window(window.top, window.left, inner.view(np.bool_))


def surroundings(window: Window, pixels: int) -> Bools:
    """Return which pixels of the window are within `pixels` of the mask, but not of it."""
    if not window.pixels.size:
        return window.pixels
    size = 2 * pixels + 1
    grown = cv2.dilate(window.pixels.view(np.uint8), np.ones((size, size), np.uint8))
    return np.asarray(grown.view(np.bool_) > window.pixels)
