"""What a model found, drawn over the image it found it in. Pure."""

import colorsys
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from schemas.compression import JPEG
from schemas.detections import TRACK_COUNT_BITS, Detection, Detections, Mask
from schemas.image import ImageFrame
from services.detector.pixels import to_bgr
from services.geometry.masks import decode

Picture = NDArray[np.uint8]
Color = tuple[int, int, int]

QUALITY: Final = 80
OPACITY: Final = 0.45
MAX_TINTS: Final = 256
FONT: Final = cv2.FONT_HERSHEY_SIMPLEX
SMALLEST_TEXT: Final = 0.4
"""Of OpenCV's font, whose capitals are about 22 pixels high at 1: less than 9 pixels nobody reads."""
GOLDEN: Final = 0.618034
"""Steps of it around the colour circle keep any number of classes apart."""
BLACK: Final = (0, 0, 0)
WHITE: Final = (255, 255, 255)
BRIGHT: Final = 140.0


def overlay(found: Detections, frame: ImageFrame, *, masks: bool) -> ImageFrame:
    """Return the frame as a JPEG with boxes, names and scores, and with masks if asked for; its header is the frame's.

    Raises:
        PictureError: the frame cannot be decoded.
    """
    picture = draw(to_bgr(frame), found.objects, masks=masks)
    height, width = picture.shape[:2]
    data = simplejpeg.encode_jpeg(picture, quality=QUALITY, colorspace="BGR", colorsubsampling="420")
    return ImageFrame(
        header=found.header,
        height=height,
        width=width,
        encoding="rgb8",
        step=width * 3,
        data=memoryview(data),
        format=JPEG,
    )


def draw(picture: Picture, objects: list[Detection], *, masks: bool) -> Picture:
    """Return a copy of a BGR picture with the objects drawn over it, the surest on top."""
    drawn = picture.copy()
    line = max(1, round(min(picture.shape[:2]) / 240))
    if masks:
        for found in reversed(objects):
            if found.mask is not None:
                _tint(drawn, found.mask, color_of(found.label))
    for found in reversed(objects):
        _frame(drawn, found, color_of(found.label), line)
    for found in reversed(objects):
        _caption(drawn, found, color_of(found.label), line)
    return drawn


def color_of(label: int) -> Color:
    """Return the colour of a class, in BGR."""
    red, green, blue = colorsys.hsv_to_rgb(label * GOLDEN % 1, 0.9, 1.0)
    return round(blue * 255), round(green * 255), round(red * 255)


def _corners(found: Detection, height: int, width: int) -> tuple[int, int, int, int]:
    box = found.box
    return int(box.x1), int(box.y1), min(int(box.x2), width - 1), min(int(box.y2), height - 1)


def _tint(drawn: Picture, mask: Mask, color: Color) -> None:
    window = decode(mask)
    under = drawn[window.place]
    if under.size:
        cv2.copyTo(cv2.LUT(under, _tints(color)), window.pixels.view(np.uint8), under)


@lru_cache(MAX_TINTS)
def _tints(color: Color) -> Picture:
    """Return what becomes of each of the 256 values of each channel under a colour."""
    values = np.arange(256, dtype=np.uint8)[:, None] * (1 - OPACITY)
    return (values + np.array(color, np.float32) * OPACITY).astype(np.uint8)[None]


def _frame(drawn: Picture, found: Detection, color: Color, line: int) -> None:
    left, top, right, bottom = _corners(found, *drawn.shape[:2])
    cv2.rectangle(drawn, (left, top), (right, bottom), color, line)


def _caption(drawn: Picture, found: Detection, color: Color, line: int) -> None:
    """Write name and score on the class's colour, inside the picture whatever the box."""
    scale = max(SMALLEST_TEXT, line * 0.22)
    (wide, high), below = cv2.getTextSize(caption(found), FONT, scale, line)
    left, top, _, _ = _corners(found, *drawn.shape[:2])
    left = max(0, min(left, drawn.shape[1] - wide - 4))
    bottom = max(high + below + 2, min(top, drawn.shape[0] - 1))
    cv2.rectangle(drawn, (left, bottom - high - below - 2), (left + wide + 4, bottom), color, cv2.FILLED)
    ink = BLACK if np.dot(color, (0.114, 0.587, 0.299)) > BRIGHT else WHITE
    cv2.putText(drawn, caption(found), (left + 2, bottom - below), FONT, scale, ink, line, cv2.LINE_AA)


def caption(found: Detection) -> str:
    """Return what is written at an object: name, score, and its number while it is tracked."""
    number = "" if found.track is None else f" #{found.track & ((1 << TRACK_COUNT_BITS) - 1)}"
    return f"{found.name} {found.score:.2f}{number}"
