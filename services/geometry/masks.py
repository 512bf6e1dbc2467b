"""Masks of objects as windows of the image: COCO run-length encoding decoded, edges taken off."""

from dataclasses import dataclass
from functools import cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Mask
from services.geometry.errors import MaskError

Bools = NDArray[np.bool_]

_FIRST: Final = np.uint8(ord("0"))
_BITS: Final = 5
_VALUE: Final = 0x1F
_MORE: Final = 0x20
_SIGN: Final = 0x10
_SIGN_PLACE: Final = 4
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
    lengths = np.empty(2 * len(starts) + 1, np.int64)
    lengths[1::2] = stops - starts
    lengths[2:-1:2] = starts[1:] - stops[:-1]
    lengths[0], lengths[-1] = starts[0] - left * height, right * height - stops[-1]
    flags = np.zeros(len(lengths), np.bool_)
    flags[1::2] = True
    columns = flags.repeat(lengths).reshape(right - left, height)
    (first_column, first), (last_column, last) = np.divmod(starts, height), np.divmod(stops - 1, height)
    whole = (first_column != last_column).any()
    top, bottom = (0, height) if whole else (int(first.min()), int(last.max()) + 1)
    top, bottom = max(top - margin, 0), min(bottom + margin, height)
    return Window(top, left, np.ascontiguousarray(columns[:, top:bottom].T))


def _runs(counts: str) -> NDArray[np.int64]:
    """Return the lengths of the runs, of clear and set pixels in turn, clear ones first.

    Raises:
        MaskError: they are not encoded as COCO does it.
    """
    try:
        codes = np.frombuffer(counts.encode("ascii"), np.uint8) - _FIRST
    except UnicodeEncodeError as error:
        raise MaskError("runs that are not ASCII text") from error
    ends = np.flatnonzero(codes & _MORE == 0) + 1
    if not len(ends) or codes.max() > _VALUE + _MORE or ends[-1] != len(codes):
        raise MaskError("runs that are not encoded as COCO does it")
    first = np.zeros_like(ends)
    first[1:] = ends[:-1]
    lengths = ends - first
    if lengths.max() > _LONGEST:
        raise MaskError("a run longer than any image")
    places = np.arange(len(codes)) - first.repeat(lengths)
    numbers = np.add.reduceat((codes & _VALUE).astype(np.int64) << _BITS * places, first)
    numbers -= (codes[ends - 1] & _SIGN).astype(np.int64) << _BITS * lengths >> _SIGN_PLACE
    numbers[1::2].cumsum(out=numbers[1::2])  # from the fourth on each is what it is more than the last but one
    numbers[2::2].cumsum(out=numbers[2::2])
    if numbers.min() < 0:
        raise MaskError("a run of less than no pixels")
    return numbers


def eroded(window: Window, pixels: int) -> Window:
    """Return the mask without what is within `pixels` of its edge, in the same window."""
    if not (pixels and window.pixels.size):
        return window
    inner = cv2.erode(window.pixels.view(np.uint8), _square(pixels), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return Window(window.top, window.left, inner.view(np.bool_))


def surroundings(window: Window, pixels: int) -> Bools:
    """Return which pixels of the window are within `pixels` of the mask, but not of it."""
    if not window.pixels.size:
        return window.pixels
    grown = cv2.dilate(window.pixels.view(np.uint8), _square(pixels))
    return np.asarray(grown.view(np.bool_) > window.pixels)


@cache
def _square(pixels: int) -> NDArray[np.uint8]:
    """Return the kernel that reaches so many pixels in each direction."""
    size = 2 * pixels + 1
    return np.ones((size, size), np.uint8)
