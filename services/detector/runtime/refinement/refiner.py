"""The interface of a refiner, independent of its library, and its close-ups. Pure."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from services.detector.runtime.candidates import Candidates

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

SIDE: Final = 64
"""Of a close-up, in pixels."""

FEATURES_SIDE: Final = SIDE // 2
"""Of the prototypes in it: they are coarser."""

CONTEXT: Final = 0.25
"""How much more than an object's box a close-up has on each side: boxes are not exact, and edges have two sides."""

CHANNELS: Final = 6
"""Red, green, blue; the coarse mask's odds; where surer objects are; the box."""

COARSE: Final = 3
"""The channel with the coarse mask's odds, 127.5 where it is as likely as not; a refiner adds to them."""

BOX: Final = 5
"""The channel that is not 0 where the box is."""

SMALL: Final = 0.05
"""The share of a mask that is a small part of it; larger ones are what posts before an object leave of it."""

WHOLE: Final = 2
"""Parts of a close-up where the mask is one of them, as most are."""

SURE: Final = 0.25
"""Score from which on an object counts as one that may hide those behind it."""


@dataclass(frozen=True, slots=True, eq=False)
class CloseUps:
    """Close-ups of objects in one image.

    pixels: n x SIDE x SIDE x CHANNELS. features: the model's prototypes there, n x FEATURES_SIDE x FEATURES_SIDE x mask
    coefficients. labels, scores: of the objects (n). windows: what each shows of the image (n x 4), its left, top,
    right and bottom in pixels of the model's input.
    """

    pixels: Bytes
    features: Floats
    labels: NDArray[np.int64]
    scores: Floats
    windows: NDArray[np.int64]


def blank_close_ups(count: int, prototypes: int) -> CloseUps:
    """Return an empty set of close-ups."""
    return CloseUps(
        np.zeros((count, SIDE, SIDE, CHANNELS), np.uint8),
        np.zeros((count, FEATURES_SIDE, FEATURES_SIDE, prototypes), np.float32),
        np.zeros(count, np.int64),
        np.full(count, 0.5, np.float32),
        np.tile(np.array([0, 0, SIDE, SIDE], np.int64), (count, 1)),
    )


def close_ups(image: Bytes, objects: Candidates, prototypes: Floats) -> CloseUps:
    """Make a close-up of each object, best first.

    image: height x width x RGB, the model's input. prototypes: mask coefficients x rows x columns, whose sums are the
    coarse masks' log odds.
    """
    step = image.shape[0] // prototypes.shape[1]
    cells = _cells(objects.corners / np.float32(step), prototypes.shape[1:])
    pixels = np.empty((len(cells), SIDE, SIDE, CHANNELS), np.uint8)
    features = np.empty((len(cells), FEATURES_SIDE, FEATURES_SIDE, len(prototypes)), np.float32)
    planes = np.ascontiguousarray(prototypes.transpose(1, 2, 0))
    odds = _odds(objects, cells, prototypes, step)
    windows = cells * step
    for n, (own, surer) in enumerate(odds):
        features[n] = _features(planes[_rectangle(cells[n])])
        colours = stretched(image[_rectangle(windows[n])])
        coarse = stretched(_byte((np.tanh(own / np.float32(4)) + np.float32(1)) / np.float32(2)))
        cv2.merge((colours, coarse, stretched(_byte(surer)), _inside(objects.corners[n], windows[n])), pixels[n])
    return CloseUps(pixels, features, objects.labels, objects.scores, windows)


def halved(features: Floats) -> NDArray[np.float16]:
    """Return features in half precision, for networks of earlier releases and to keep them; the largest are cut."""
    most = np.finfo(np.float16).max
    return np.clip(features, -most, most).astype(np.float16)


def own_parts(mask: NDArray[np.bool_], inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Remove small parts of a mask outside the object's box: they belong to similar objects.

    mask, inside: SIDE x SIDE, the second where the box is.
    """
    count, parts = cv2.connectedComponents(mask.view(np.uint8), connectivity=8)
    if count <= WHOLE:
        return mask
    own = np.bincount(parts.ravel()) >= SMALL * np.count_nonzero(mask)
    own[parts[inside]] = True
    own[0] = False  # what is no part
    return np.asarray(own[parts], np.bool_)


def stretched(window: Bytes) -> Bytes:
    """Scale a window (rows x columns or rows x columns x channels) of an image to a square of SIDE."""
    height, width = min(window.shape[0], SIDE), min(window.shape[1], SIDE)
    if (height, width) != window.shape[:2]:
        window = np.asarray(cv2.resize(window, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    if (height, width) != (SIDE, SIDE):
        window = np.asarray(cv2.resize(window, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR), np.uint8)
    return window


def _features(planes: Floats) -> Floats:
    """Scale smooth features to a square of FEATURES_SIDE; OpenCV averages at most four channels at once."""
    size = (FEATURES_SIDE, FEATURES_SIDE)
    return np.asarray(cv2.resize(planes, size, interpolation=cv2.INTER_LINEAR), np.float32).reshape(*size, -1)


def _cells(corners: Floats, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return the windows of boxes, in places of the prototypes, of which each has at least one."""
    size = np.array([shape[1], shape[0]])
    margins = (corners[:, 2:] - corners[:, :2]) * CONTEXT
    low = np.clip(np.floor(corners[:, :2] - margins), 0, size - 1)
    high = np.clip(np.ceil(corners[:, 2:] + margins), low + 1, size)
    return np.concatenate([low, high], axis=1).astype(np.int64)


def _odds(
    objects: Candidates, cells: NDArray[np.int64], prototypes: Floats, step: int
) -> Iterator[tuple[Floats, Floats]]:
    """Yield, within each object's window, its log odds and the probability of better objects there."""
    boxes = np.clip(np.rint(objects.corners / step), 0, [*prototypes.shape[:0:-1]] * 2).astype(np.int64)
    taken = np.zeros(prototypes.shape[1:], np.float32)
    for n, (left, top, _, _) in enumerate(cells.tolist()):
        window = _rectangle(cells[n])
        own = np.einsum("c,chw->hw", objects.coefficients[n], prototypes[:, *window])  # no BLAS, so no threads
        yield own, taken[window]
        if objects.scores[n] >= SURE:
            first, upper, last, lower = boxes[n].tolist()
            inner = _rectangle(boxes[n])
            likely = 1 / (1 + np.exp(-own[upper - top : lower - top, first - left : last - left]))
            taken[inner] = np.maximum(taken[inner], likely)


def _byte(share: Floats) -> Bytes:
    return np.rint(share * 255).astype(np.uint8)


def _rectangle(sides: NDArray[np.int64]) -> tuple[slice, slice]:
    """Return the rows and columns between a left, top, right and bottom side."""
    left, top, right, bottom = sides.tolist()
    return slice(top, bottom), slice(left, right)


def _inside(corners: Floats, window: NDArray[np.int64]) -> Bytes:
    """Return a square of SIDE that is 255 inside a box and 0 around it."""
    left, top, right, bottom = window.tolist()
    places = (np.arange(SIDE, dtype=np.float32) + 0.5) / SIDE
    across, down = left + places * (right - left), top + places * (bottom - top)
    columns = (across >= corners[0]) & (across < corners[2])
    rows = (down >= corners[1]) & (down < corners[3])
    return np.where(rows[:, None] & columns, np.uint8(255), np.uint8(0))


AT_ONCE: Final = 32
"""Close-ups that are computed together: more need more memory, and are no quicker each."""


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """Masks of objects in their close-ups.

    odds: log odds, n x SIDE x SIDE. qualities: the IoU to expect of each mask with the true one (n), 0 to 1.
    """

    odds: Floats
    qualities: Floats


class Refiner(Protocol):
    """Refines masks. Used from one thread at a time."""

    def run(self, seen: CloseUps) -> Refined:
        """Refine the mask of each object."""


def refined(seen: CloseUps, compute: Callable[[list[NDArray[Any]]], tuple[Floats, Floats]]) -> Refined:
    """Refine a few objects at a time. compute: maps the inputs of `RefinerNetwork.forward` to its outputs."""
    given: tuple[NDArray[Any], ...] = (seen.pixels, seen.features, seen.labels, seen.scores)
    count = len(seen.labels)
    found = Refined(np.empty((count, SIDE, SIDE), np.float32), np.empty(count, np.float32))
    for begin in range(0, count, AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        found.odds[part], qualities = compute([each[part] for each in given])
        found.qualities[part] = 1 / (1 + np.exp(-qualities.astype(np.float64)))  # whose range is never left
    return found
