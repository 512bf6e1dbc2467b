"""Masks of objects as windows of the image: their runs decoded, edges taken off."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Mask
from services.geometry.errors import MaskError
from services.geometry.runs import Runs

Bools = NDArray[np.bool_]

MANY_PIXELS: Final = 1 << 25
MANY_CHARACTERS: Final = 1 << 20
"""Masks of more pixels, or of more text, are not decoded at once."""


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
    return next(_windows(Runs.of([mask.counts], height, width), width, margin))


def decode_all(masks: Iterable[Mask], *, margin: int = 0) -> Iterator[Window | MaskError]:
    """Decode masks as `decode` does it, several at a time; where one is damaged there is the error."""
    for group in _groups(masks):
        height, width = group[0].size
        try:
            yield from _windows(Runs.of([mask.counts for mask in group], height, width), width, margin)
        except MaskError:
            yield from (_decoded(mask, margin) for mask in group)


def _decoded(mask: Mask, margin: int) -> Window | MaskError:
    try:
        return decode(mask, margin=margin)
    except MaskError as error:
        return error


def _groups(masks: Iterable[Mask]) -> Iterator[list[Mask]]:
    """Return masks of the same size, so few that they are decoded in little memory."""
    group: list[Mask] = []
    pixels = characters = 0
    for mask in masks:
        height, width = mask.size
        pixels += height * width
        characters += len(mask.counts)
        if group and (mask.size != group[0].size or pixels > MANY_PIXELS or characters > MANY_CHARACTERS):
            yield group
            group, pixels, characters = [], height * width, len(mask.counts)
        group.append(mask)
    if group:
        yield group


def _windows(runs: Runs, width: int, margin: int) -> Iterator[Window]:
    """Return the windows of masks of images so wide."""
    height = runs.height
    some = np.flatnonzero(np.diff(runs.bounds))
    lefts = np.arange(len(runs.bounds) - 1) * width
    borders, rights = lefts[some], lefts.copy()
    tops, bottoms = np.zeros_like(lefts), np.zeros_like(lefts)
    if len(some):
        begins = runs.bounds[some]
        (first_columns, first), (last_columns, last) = np.divmod(runs.starts, height), np.divmod(runs.stops - 1, height)
        whole = np.logical_or.reduceat(first_columns != last_columns, begins)
        tops[some] = np.where(whole, 0, np.maximum(np.minimum.reduceat(first, begins) - margin, 0))
        bottoms[some] = np.where(whole, height, np.minimum(np.maximum.reduceat(last, begins) + 1 + margin, height))
        lefts[some] = np.maximum(first_columns[begins] - margin, borders)
        rights[some] = np.minimum(last_columns[runs.bounds[some + 1] - 1] + 1 + margin, borders + width)
    columns = runs.pixels(lefts, rights).reshape(-1, height)
    end = 0
    for top, bottom, left, right in zip(*(each.tolist() for each in (tops, bottoms, lefts, rights)), strict=True):
        start, end = end, end + right - left
        pixels = np.ascontiguousarray(columns[start:end, top:bottom].T)
        yield Window(top, left % width if end > start else 0, pixels)


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
