"""A picture that is collected: its file, its likeness to others, its labels. Pure."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.compression import JPEG
from schemas.detections import Box, Detection, Detections
from schemas.image import ImageFrame
from services.detector.overlay import jpeg_of
from services.detector.pixels import to_bgr
from services.geometry.errors import MaskError
from services.geometry.masks import decode
from services.geometry.outlines import outline

HASH_SIDE: Final = 8
BLUR_PARTS: Final = 6
"""How many patches of one colour a blurred object keeps along its shorter side."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A colour image.

    file: JPEG. fingerprint: 64 bits, few of which differ between pictures that look alike. blurred: the classes of
    which objects are blurred in it.
    """

    frame: ImageFrame
    pixels: NDArray[np.uint8]
    file: bytes
    fingerprint: int
    blurred: tuple[str, ...] = ()


def picture_of(frame: ImageFrame) -> Picture:
    """Decode an image, and encode it unless it is a JPEG file already.

    Raises:
        ValueError: it cannot be decoded.
    """
    pixels = to_bgr(frame)
    return Picture(frame, pixels, bytes(frame.data) if frame.format == JPEG else jpeg_of(pixels), fingerprint(pixels))


def fingerprint(pixels: NDArray[np.uint8]) -> int:
    """Return whether brightness rises from left to right, in 8 x 8 places of a BGR image, as the bits of a number.

    Known as difference hash or dHash.
    """
    grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    small = cv2.resize(grey, (HASH_SIDE + 1, HASH_SIDE), interpolation=cv2.INTER_AREA).astype(np.int16)
    return int.from_bytes(np.packbits(small[:, 1:] > small[:, :-1]).tobytes())


def blurred(picture: Picture, objects: Collection[Detection], names: Collection[str]) -> Picture:
    """Return the picture with the objects of these classes made unrecognisable, whole boxes of them."""
    pixels, changed = picture.pixels.copy(), set[str]()
    for each in objects:
        rows, columns = _place(each.box, pixels)
        if each.name in names and pixels[rows, columns].size:
            pixels[rows, columns] = _patches(pixels[rows, columns])
            changed.add(each.name)
    if not changed:
        return picture
    return replace(picture, pixels=pixels, file=jpeg_of(pixels), blurred=tuple(sorted(changed)))


def labels(found: Detections, codes: Mapping[str, int]) -> Iterator[str]:
    """Yield a line of YOLO's segmentation form for each object of the classes that have a code.

    That is the code and a polygon, its coordinates as shares of width and height: around the mask, or the box where
    there is no mask.
    """
    size = np.array([found.width, found.height])
    for each in found.objects:
        if each.name in codes:
            corners = np.clip(_polygon(each) / size, 0, 1)
            yield f"{codes[each.name]} {' '.join(f'{value:.5f}' for value in corners.ravel())}\n"


def _polygon(found: Detection) -> NDArray[np.float64]:
    if found.mask is not None:
        try:
            window = decode(found.mask)
        except MaskError:  # a damaged mask says no less about the box
            pass
        else:
            around = outline(window.pixels.astype(np.uint8)) if window.pixels.size else None
            if around is not None:
                return np.add(around, (window.left + 0.5, window.top + 0.5))
    box = found.box
    return np.array([(box.x1, box.y1), (box.x2, box.y1), (box.x2, box.y2), (box.x1, box.y2)])


def _place(box: Box, pixels: NDArray[np.uint8]) -> tuple[slice, slice]:
    height, width = pixels.shape[:2]
    left, right = np.clip([np.floor(box.x1), np.ceil(box.x2)], 0, width).astype(int).tolist()
    top, bottom = np.clip([np.floor(box.y1), np.ceil(box.y2)], 0, height).astype(int).tolist()
    return slice(top, bottom), slice(left, right)


def _patches(window: NDArray[np.uint8]) -> NDArray[np.uint8]:
    height, width = window.shape[:2]
    scale = BLUR_PARTS / max(1, min(height, width))
    few = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(window, few, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), np.uint8)
