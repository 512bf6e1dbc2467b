"""Compressed pictures: what a file's own header says of its pixels, before anything is decoded."""

import struct
from dataclasses import dataclass
from typing import Final

from schemas.errors import SchemaError

JPEG: Final = "jpeg"
PNG: Final = "png"

_JPEG_START: Final = b"\xff\xd8"
_PNG_START: Final = b"\x89PNG\r\n\x1a\n\x00\x00\x00\x0dIHDR"
_PNG_SIZE: Final = struct.Struct(">IIBB")
_PNG_ENCODINGS: Final = {(8, 0): "mono8", (16, 0): "mono16", (8, 2): "rgb8", (8, 3): "rgb8", (8, 6): "rgba8"}
_SEGMENT: Final = struct.Struct(">BBH")
_FILL: Final = 0xFF
_FRAME: Final = struct.Struct(">BHHB")
_FRAME_MARKERS: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_ENCODINGS: Final = {1: "mono8", 3: "rgb8"}


@dataclass(frozen=True, slots=True)
class Picture:
    """A compressed picture's format, its size in pixels, and the encoding that it holds them in."""

    format: str
    height: int
    width: int
    encoding: str


def picture_of(data: memoryview) -> Picture:
    """Read the header of a JPEG or PNG file; palettes count as rgb8.

    Raises:
        SchemaError: neither of them, cut off before its size, or with pixels that the contract does not carry.
    """
    try:
        if bytes(data[: len(_PNG_START)]) == _PNG_START:
            return _png(data)
        if bytes(data[: len(_JPEG_START)]) == _JPEG_START:
            return _jpeg(data)
    except struct.error as error:
        raise SchemaError(f"a picture cut off at {data.nbytes} bytes") from error
    raise SchemaError(f"neither a JPEG nor a PNG file: it begins with {bytes(data[:8])!r}")


def _png(data: memoryview) -> Picture:
    width, height, bits, color = _PNG_SIZE.unpack_from(data, len(_PNG_START))
    if (bits, color) not in _PNG_ENCODINGS:
        raise SchemaError(f"a PNG file with {bits} bits and colour type {color}")
    return Picture(PNG, height, width, _PNG_ENCODINGS[bits, color])


def _jpeg(data: memoryview) -> Picture:
    at = len(_JPEG_START)
    while True:
        start, marker, length = _SEGMENT.unpack_from(data, at)
        if start == marker == _FILL:
            at += 1
            continue
        if start != 0xFF or length < 2:
            raise SchemaError(f"a JPEG file with {start:#x} {marker:#x} at byte {at}")
        if marker in _FRAME_MARKERS:
            _, height, width, channels = _FRAME.unpack_from(data, at + _SEGMENT.size)
            if channels not in _JPEG_ENCODINGS:
                raise SchemaError(f"a JPEG file with {channels} channels")
            return Picture(JPEG, height, width, _JPEG_ENCODINGS[channels])
        at += 2 + length
