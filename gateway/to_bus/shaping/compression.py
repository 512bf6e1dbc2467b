"""Compresses frames: JPEG for colour, lossless for everything else. Pure.

Frames that a method cannot hold are compressed by zstd instead: depth, 16 bits and mosaics are not for JPEG, and metres
and points not for PNG. Frames that arrive compressed stay as they are.
"""

import re
import struct
import sys
import zlib
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from gateway.to_bus.shaping.scaling import pixels_of
from schemas.compression import JPEG, PNG, RAW, ZSTD
from schemas.image import BYTES_PER_PIXEL, ImageFrame
from schemas.points import PointCloud

LEVEL: Final = 1
"""zlib's fastest level: processor time on a robot is worth more than a few per cent of size."""

_START: Final = b"\x89PNG\r\n\x1a\n"
_COLOUR_TYPES: Final = {1: 0, 3: 2, 4: 6}


def encode_png(pixels: NDArray[Any]) -> bytes:
    """Return a PNG file of pixels height x width x 1, 3 or 4, of 8 or 16 bits, grey or red first."""
    height, width, channels = pixels.shape
    bits = pixels.dtype.itemsize * 8
    head = struct.pack(">IIBBBBB", width, height, bits, _COLOUR_TYPES[channels], 0, 0, 0)
    rows = np.ascontiguousarray(pixels, dtype=f">u{bits // 8}").view(np.uint8).reshape(height, -1)
    filtered = _filtered(rows, channels * bits // 8)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(filtered.data, LEVEL)), (b"IEND", b""))
    return _START + b"".join(_chunk(name, data) for name, data in chunks)


def _filtered(rows: NDArray[np.uint8], pixel: int) -> NDArray[np.uint8]:
    """Return the PNG rows, each after its filter number: none, difference to the left, or to the row above.

    The filter that leaves the smallest differences is taken, as the standard suggests (12.8).
    """
    before, above = rows.copy(), rows.copy()
    before[:, pixel:] -= rows[:, :-pixel]
    above[1:] -= rows[:-1]
    choices = np.stack([rows, before, above])
    best = np.abs(choices.view(np.int8).astype(np.int16)).sum(axis=2, dtype=np.int64).argmin(axis=0)
    lines = np.arange(len(rows))
    return np.concatenate([best[:, np.newaxis].astype(np.uint8), choices[best, lines]], axis=1)


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

AUTO: Final = "auto"
QUALITY_AND_LEVEL_LIMITS: Final = {JPEG: (1, 80, 100), ZSTD: (1, 1, 19)}
"""Smallest, usual and largest quality or level. The quality of overlays' JPEGs is in services/detector/overlay.py."""

_METHOD: Final = re.compile(r"(auto|raw|png|jpeg|zstd)(?::(\d{1,3}))?")
_JPEG_SPACES: Final = {"rgb8": "RGB", "bgr8": "BGR", "rgba8": "RGBA", "bgra8": "BGRA", "mono8": "GRAY"}
_PNG_ORDERS: Final = {"bgr8": ("rgb8", [2, 1, 0]), "bgra8": ("rgba8", [2, 1, 0, 3])}
_NOT_FOR_PNG: Final = frozenset({"32FC1", "yuv422"})
_FULL_LUMA: Final = np.clip((np.arange(256) - 16) * (255 / 219) + 0.5, 0, 255).astype(np.uint8)
_FULL_CHROMA: Final = np.clip((np.arange(256) - 128) * (255 / 224) + 128.5, 0, 255).astype(np.uint8)

Frame = ImageFrame | PointCloud


@dataclass(frozen=True, slots=True)
class Method:
    """A compression method. level: JPEG's quality or zstd's level; None for formats without."""

    format: str
    level: int | None = None

    def __str__(self) -> str:
        return self.format if self.level is None else f"{self.format}:{self.level}"


NONE: Final = Method(RAW)
LOSSLESS: Final = Method(ZSTD, QUALITY_AND_LEVEL_LIMITS[ZSTD][1])
LOSSY: Final = Method(JPEG, QUALITY_AND_LEVEL_LIMITS[JPEG][1])


def parse_method(text: str) -> Method:
    """Return the method for its text in the settings, like `jpeg:80`.

    Raises:
        ValueError: naming what can be written.
    """
    match = _METHOD.fullmatch(text)
    if match is None or (match[2] and match[1] not in QUALITY_AND_LEVEL_LIMITS):
        raise ValueError(f"{text!r} is not one of auto, raw, jpeg, jpeg:QUALITY, png, zstd, zstd:LEVEL")
    if match[1] not in QUALITY_AND_LEVEL_LIMITS:
        return Method(match[1])
    least, usual, most = QUALITY_AND_LEVEL_LIMITS[match[1]]
    level = int(match[2] or usual)
    if not least <= level <= most:
        raise ValueError(f"{text!r}: {match[1]} goes from {least} to {most}")
    return Method(match[1], level)


def compress(frame: Frame, method: Method) -> tuple[Frame, Method]:
    """Return the compressed frame, and the method that was used."""
    if frame.format != RAW or method.format == RAW:
        return frame, Method(frame.format)
    if isinstance(frame, ImageFrame) and method.format == JPEG and frame.encoding in {*_JPEG_SPACES, "yuv422"}:
        return _jpeg(frame, method), method
    if isinstance(frame, ImageFrame) and method.format == PNG and frame.encoding not in _NOT_FOR_PNG:
        return _png(frame), method
    method = method if method.format == ZSTD else LOSSLESS
    data = zstd.compress(frame.data, method.level)
    return msgspec.structs.replace(frame, format=ZSTD, data=memoryview(data)), method


def _jpeg(frame: ImageFrame, method: Method) -> ImageFrame:
    pixels = pixels_of(frame)
    if frame.encoding == "yuv422":
        planes = _planes(pixels)
        return _file(frame, "rgb8", JPEG, simplejpeg.encode_jpeg_yuv_planes(*planes, quality=method.level or 0))
    grey = frame.encoding == "mono8"
    space, sampling = _JPEG_SPACES[frame.encoding], "Gray" if grey else "420"
    data = simplejpeg.encode_jpeg(np.ascontiguousarray(pixels), method.level or 0, space, sampling)
    return _file(frame, "mono8" if grey else "rgb8", JPEG, data)


def _planes(uyvy: NDArray[Any]) -> list[NDArray[np.uint8]]:
    """Return luma and chroma scaled to JPEG's full range from a camera's limited range."""
    return [_FULL_LUMA[uyvy[..., 1]], _FULL_CHROMA[uyvy[:, 0::2, 0]], _FULL_CHROMA[uyvy[:, 1::2, 0]]]


def _png(frame: ImageFrame) -> ImageFrame:
    encoding, order = _PNG_ORDERS.get(frame.encoding, (frame.encoding, None))
    pixels = pixels_of(frame)
    return _file(frame, encoding, PNG, encode_png(pixels if order is None else pixels[..., order]))


def _file(frame: ImageFrame, encoding: str, kind: str, data: bytes) -> ImageFrame:
    step = frame.width * BYTES_PER_PIXEL[encoding]
    return msgspec.structs.replace(
        frame, encoding=encoding, step=step, is_bigendian=False, format=kind, data=memoryview(data)
    )
