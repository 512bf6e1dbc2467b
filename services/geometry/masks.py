"""Decodes masks of objects to windows of the image, and trims their edges."""

import math
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Mask
from services.geometry.errors import MaskError
from services.geometry.runs import Integers, Runs

Bools = NDArray[np.bool_]

MANY_PIXELS: Final = 1 << 25
MANY_CHARACTERS: Final = 1 << 20
"""Masks with more pixels, or more text, in total are not decoded at once."""

MAX_PIXELS: Final = 1 << 27
"""Number of pixels that the windows of one message's masks have in total at most: run lengths of a few kilobytes can
stand for gigabytes. Sixteen masks that each cover all of an 8-megapixel image fit."""

MEASURED_PIXELS: Final = 1 << 25
"""The same of masks that are measured in depth or points, which takes longer: four times an 8-megapixel image."""


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A mask, cropped to the rows and columns with pixels. pixels: height x width.

    top, left: where in the image its first row and column are. step: pixels of the image from one row, or column, of
    the window to the next.
    """

    top: int
    left: int
    pixels: Bools
    step: int = 1

    @property
    def place(self) -> tuple[slice, slice]:
        """The rows and columns of the image that the window covers."""
        height, width = self.pixels.shape
        down, across = height * self.step, width * self.step
        return slice(self.top, self.top + down, self.step), slice(self.left, self.left + across, self.step)

    @property
    def area(self) -> int:
        """How many pixels the mask has."""
        return int(np.count_nonzero(self.pixels))


def decode(mask: Mask, *, margin: int = 0) -> Window:
    """Decode a mask; an empty one is a window without pixels.

    margin: rows and columns around it that the window has too, as far as the image goes.

    Raises:
        MaskError: the runs are damaged, do not fill the image, or cover more than MAX_PIXELS.
    """
    (window,) = decode_all([mask], margin=margin)
    if isinstance(window, MaskError):
        raise window
    return window


def decode_all(
    masks: Iterable[Mask], *, margin: int = 0, most: int = MAX_PIXELS, each: int = MAX_PIXELS
) -> Iterator[Window | MaskError]:
    """Decode the masks of one message like `decode`, several at a time.

    most: pixels that their windows have together. The error stands in place of a damaged one, and of those for which
    there is no room left. each: about how many pixels are left of one window, whose margin counts these; larger ones
    are thinned.
    """
    room = most
    too_large = f"the masks in one image cover over {most / 1_000_000:.3g} million pixels together"
    for group in _groups(masks, most):
        height, width = group[0].size
        around = margin * _thinning(height, width, each)
        for runs in _runs([mask.counts for mask in group], height, width):
            if isinstance(runs, MaskError):
                yield runs
                continue
            for pixels in _windows(runs, width, around, room):
                if pixels is None:
                    yield MaskError(too_large)
                    continue
                room -= pixels.columns.size
                yield pixels.window(each)


def _thinning(height: int, width: int, most: int) -> int:
    """Return which rows and columns of an area are kept so that about `most` of its pixels are left: every nth."""
    return max(1, math.ceil(math.sqrt(height * width / most)))


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """A window's pixels as they are decoded. columns: width x height."""

    top: int
    left: int
    columns: Bools

    def window(self, most: int) -> Window:
        """Return it with about so many pixels at most."""
        width, height = self.columns.shape
        step = _thinning(height, width, most)
        return Window(self.top, self.left, _transposed(self.columns[::step, ::step]), step)


def _transposed(pixels: Bools) -> Bools:
    """Return the transpose as an array of its own: OpenCV goes by blocks, NumPy takes ten times as long."""
    if not pixels.size:
        return pixels.T
    return np.asarray(cv2.transpose(np.ascontiguousarray(pixels).view(np.uint8)).view(np.bool_))


def _runs(texts: list[str], height: int, width: int) -> Iterator[Runs | MaskError]:
    """Yield the runs of all masks together; where one is damaged, of each alone, or the error."""
    try:
        yield Runs.of(texts, height, width)
    except MaskError as error:
        if len(texts) == 1:
            yield error
            return
        for text in texts:
            yield from _runs([text], height, width)


def _groups(masks: Iterable[Mask], most: int) -> Iterator[list[Mask]]:
    """Yield groups of masks of the same size that are decoded in little memory, as their windows are in `most` pixels.

    A thousand large masks of which few have room are one group: two at a time would take a hundred times as long.
    """
    many_pixels = MANY_PIXELS if most > MANY_PIXELS else sys.maxsize
    group: list[Mask] = []
    pixels = characters = 0
    for mask in masks:
        height, width = mask.size
        pixels += height * width
        characters += len(mask.counts)
        if group and (mask.size != group[0].size or pixels > many_pixels or characters > MANY_CHARACTERS):
            yield group
            group, pixels, characters = [], height * width, len(mask.counts)
        group.append(mask)
    if group:
        yield group


def _windows(runs: Runs, width: int, margin: int, room: int) -> Iterator[_Drawn | None]:
    """Return the windows of masks of images of this width; None for those that have no room in this many pixels."""
    counts = runs.bounds[1:] - runs.bounds[:-1]
    some = counts.nonzero()[0]
    begins, counts_of_some = runs.bounds[some], counts[some]
    columns, first = np.divmod(runs.starts, runs.height)
    lengths = runs.stops - runs.starts
    ends = np.maximum.reduceat(first + lengths, begins)
    tops = np.maximum(np.minimum.reduceat(first, begins) - margin, 0)
    tops[ends > runs.height] = 0  # a run goes on in the next column
    borders = some * width
    lefts = np.maximum(columns[begins] - margin, borders)
    lasts = (runs.stops[begins + counts_of_some - 1] - 1) // runs.height
    highs = np.minimum(ends + margin, runs.height) - tops
    wides = np.minimum(lasts + 1 + margin, borders + width) - lefts
    areas = highs * wides
    fit = _fitting(areas, room)
    stops = (areas * fit).cumsum()
    shifts = stops - areas - lefts * highs - tops
    starts = columns * highs.repeat(counts_of_some) + first + shifts.repeat(counts_of_some)
    drawn = fit.repeat(counts_of_some)
    pixels = _drawn(starts[drawn], (starts + lengths)[drawn], int(stops[-1]) if len(stops) else 0)
    places = zip(*(each.tolist() for each in (fit, tops, lefts - borders, highs, wides, stops)), strict=True)
    for count in counts.tolist():
        if not count:
            yield _Drawn(0, 0, np.zeros((0, 0), np.bool_))
            continue
        fits, top, left, high, wide, stop = next(places)
        yield _Drawn(top, left, pixels[stop - high * wide : stop].reshape(wide, high)) if fits else None


def _fitting(areas: Integers, room: int) -> Bools:
    """Return which windows have room: each in turn that fits beside those before it."""
    fit = np.zeros(len(areas), np.bool_)
    for place, area in enumerate(areas.tolist()):
        fit[place] = area <= room
        room -= area if area <= room else 0
    return fit


def _drawn(starts: Integers, stops: Integers, size: int) -> Bools:
    """Return an array of this many pixels, with those of the runs set."""
    edges = np.zeros(2 * len(starts) + 2, np.int64)
    edges[1:-1:2], edges[2:-1:2], edges[-1] = starts, stops, size
    is_set = np.zeros(len(edges) - 1, np.bool_)
    is_set[1::2] = True
    return is_set.repeat(edges[1:] - edges[:-1])


def eroded(window: Window, pixels: int) -> Window:
    """Return the mask without what is within `pixels` of the image of its edge, in the same window."""
    if not (pixels and window.pixels.size):
        return window
    square = _square(math.ceil(pixels / window.step))
    inner = cv2.erode(window.pixels.view(np.uint8), square, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return Window(window.top, window.left, inner.view(np.bool_), window.step)


def surroundings(window: Window, pixels: int) -> Bools:
    """Return which pixels of the window are within `pixels` of the window of the mask, but not of it."""
    if not window.pixels.size:
        return window.pixels
    grown = cv2.dilate(window.pixels.view(np.uint8), _square(pixels))
    return np.asarray(grown.view(np.bool_) > window.pixels)


@cache
def _square(pixels: int) -> NDArray[np.uint8]:
    """Return the kernel that reaches this many pixels in each direction."""
    size = 2 * pixels + 1
    return np.ones((size, size), np.uint8)
