"""Draws a model's detections over the image they were found in. Pure."""

import colorsys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from schemas.compression import JPEG
from schemas.detections import IN_VIEW, TRACK_COUNT_BITS, Box, Detection, Detections
from schemas.header import Header
from schemas.image import ImageFrame
from services.detector.pixels import to_bgr
from services.detector.runtime.object_shapes import corners_of, shown_limbs
from services.geometry.masks import Window, decode_all

Picture = NDArray[np.uint8]
Color = tuple[int, int, int]

OVERLAY_JPEG_QUALITY: Final = 80
OPACITY: Final = 0.45
MAX_COLORS: Final = 256
FONT: Final = cv2.FONT_HERSHEY_SIMPLEX
SMALLEST_TEXT: Final = 0.4
"""Minimum scale of OpenCV's font, whose capitals are about 22 pixels high at 1: below 9 pixels it is illegible."""
GOLDEN: Final = 0.618034
"""Steps of it around the colour circle keep any number of classes apart."""
BLACK: Final = (0, 0, 0)
WHITE: Final = (255, 255, 255)
BRIGHT: Final = 140.0


def overlays(found: Detections, frame: ImageFrame, masks: Iterable[bool]) -> Iterator[ImageFrame]:
    """Return the frame as one JPEG per item of `masks` (draw masks or not), with boxes, names and scores.

    Each is made when it is asked for, and what they share once. Their headers are the frame's.

    Raises:
        MaskError: a mask is damaged.
        ImageDecodeError: the frame cannot be decoded.
    """
    picture = to_bgr(frame)
    for drawn in drawings(picture, found.objects, masks):
        yield _frame(found.header, drawn)


def jpeg_of(drawn: Picture) -> bytes:
    """Encode a BGR image as a JPEG file."""
    data: bytes = simplejpeg.encode_jpeg(drawn, quality=OVERLAY_JPEG_QUALITY, colorspace="BGR", colorsubsampling="420")
    return data


def _frame(header: Header, drawn: Picture) -> ImageFrame:
    height, width = drawn.shape[:2]
    return ImageFrame(
        header=header,
        height=height,
        width=width,
        encoding="rgb8",
        step=width * 3,
        data=memoryview(jpeg_of(drawn)),
        format=JPEG,
    )


def drawings(picture: Picture, objects: Sequence[Detection], masks: Iterable[bool]) -> Iterator[Picture]:
    """Return a copy of a BGR image per item of `masks`, with the objects drawn over it, the highest score on top.

    Each is made when it is asked for, and what they share once.

    Raises:
        MaskError: a mask is damaged.
    """
    line = max(1, round(min(picture.shape[:2]) / 240))
    above = Counter[Box]()
    signs: list[_Sign] = []
    for found in objects:
        signs.append(_Sign.of(found, line, above[found.box]))
        above[found.box] += 1
    signs.reverse()  # the best is drawn last
    for each in masks:
        drawn = picture.copy()
        if each:
            _tint(drawn, list(reversed(objects)))
        for sign in signs:
            sign.frame(drawn)
        for sign in signs:
            sign.write(drawn)
        yield drawn


@dataclass(frozen=True, slots=True, eq=False)
class _Sign:
    """An object's box and its rendered caption. line: width in pixels. above: captions at the same box above it."""

    found: Detection
    color: Color
    line: int
    caption: Picture
    above: int

    @classmethod
    def of(cls, found: Detection, line: int, above: int) -> "_Sign":
        color = color_of(found.label)
        return cls(found, color, line, _written(caption(found), color, line), above)

    def frame(self, drawn: Picture) -> None:
        """Draw the box, upright or rotated, and keypoints in it."""
        if self.found.rotated is not None:
            corners = np.rint(corners_of(self.found.rotated)).astype(np.int32)
            cv2.polylines(drawn, [corners], isClosed=True, color=self.color, thickness=self.line)
        else:
            left, top, right, bottom = self._corners(*drawn.shape[:2])
            cv2.rectangle(drawn, (left, top), (right, bottom), self.color, self.line)
        points = self.found.keypoints or ()
        for one, other in shown_limbs(points):
            begin, end = ((int(each.x), int(each.y)) for each in (points[one], points[other]))
            cv2.line(drawn, begin, end, self.color, self.line)
        for each in points:
            if each.score >= IN_VIEW:
                cv2.circle(drawn, (int(each.x), int(each.y)), self.line + 1, WHITE, cv2.FILLED)

    def write(self, drawn: Picture) -> None:
        """Draw the caption at the box, always inside the image."""
        (height, width), (high, wide) = drawn.shape[:2], self.caption.shape[:2]
        left, top, _, _ = self._corners(height, width)
        left = max(0, min(left, width - wide + 1))
        top = max(0, min(top, height - 1) - high + 1) + self.above * high
        under = drawn[top : top + high, left : left + wide]
        under[...] = self.caption[: under.shape[0], : under.shape[1]]

    def _corners(self, height: int, width: int) -> tuple[int, int, int, int]:
        box = self.found.box
        return int(box.x1), int(box.y1), min(int(box.x2), width - 1), min(int(box.y2), height - 1)


@lru_cache(MAX_COLORS)
def color_of(label: int) -> Color:
    """Return the colour of a class, in BGR."""
    red, green, blue = colorsys.hsv_to_rgb(label * GOLDEN % 1, 0.9, 1.0)
    return round(blue * 255), round(green * 255), round(red * 255)


def _tint(drawn: Picture, objects: Sequence[Detection]) -> None:
    """Blend each object's mask into the image, in turn.

    Raises:
        MaskError: a mask is damaged.
    """
    masked = [found for found in objects if found.mask is not None]
    windows = decode_all(found.mask for found in masked if found.mask is not None)
    for found, window in zip(masked, windows, strict=True):
        if not isinstance(window, Window):
            raise window
        under = drawn[window.place]
        if under.size:
            cv2.copyTo(cv2.LUT(under, _tints(color_of(found.label))), window.pixels.view(np.uint8), under)


@lru_cache(MAX_COLORS)
def _tints(color: Color) -> Picture:
    """Return the lookup table (256 values per channel) that blends with a colour."""
    values = np.arange(256, dtype=np.uint8)[:, None] * (1 - OPACITY)
    return (values + np.array(color, np.float32) * OPACITY).astype(np.uint8)[None]


def _written(text: str, color: Color, line: int) -> Picture:
    """Return a rendered text on a background of the class's colour."""
    scale = max(SMALLEST_TEXT, line * 0.22)
    (wide, high), below = cv2.getTextSize(text, FONT, scale, line)
    ground = np.full((high + below + 3, wide + 5, 3), color, np.uint8)
    ink = BLACK if np.dot(color, (0.114, 0.587, 0.299)) > BRIGHT else WHITE
    return np.asarray(cv2.putText(ground, text, (2, high + 2), FONT, scale, ink, line, cv2.LINE_AA), np.uint8)


def caption(found: Detection) -> str:
    """Return the caption of an object: name, score, and track number if it is tracked."""
    number = "" if found.track is None else f" #{found.track & ((1 << TRACK_COUNT_BITS) - 1)}"
    return f"{found.name} {found.score:.2f}{number}"
