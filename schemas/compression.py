"""Reads the headers of compressed data, so that its content is checked before decoding."""

import math
import re
import struct
from dataclasses import dataclass
from typing import Final

from schemas.errors import SchemaError

JPEG_START: Final = b"\xff\xd8\xff"
FRAME_MARKERS: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of the segment with the picture's size."""
MAX_MARKERS: Final = 10_000
"""Real files have some dozens, or a few hundred with a large colour profile."""

_SCAN: Final = 0xDA
_END: Final = 0xD9
_SEQUENTIAL: Final = frozenset({0xC0, 0xC1})
_BLOCK: Final = 8
_SCAN_SEGMENT: Final = re.compile(rb"\xff([\x02-\xcf\xd8-\xfe])")
"""The start of a marker: coded pixels have a zero after each 0xff, or a restart marker, which has no length."""
_LENGTH: Final = struct.Struct(">H")
_SCAN_FRAME: Final = struct.Struct(">HBHHB")
_SCANNED: Final = struct.Struct(">HB")


def scanned_pixels(data: bytes | memoryview) -> int:
    """Return the component-pixels that a decoder visits: of each component of each scan, as libjpeg reads it.

    Data after the image's end or inside segments does not count: phones put videos and previews there.

    Raises:
        ValueError: the file has more markers than MAX_MARKERS.
    """
    at, passes, pixels, all_at_once = len(JPEG_START) - 1, 0, 0, 0
    for _ in range(MAX_MARKERS):
        found = _SCAN_SEGMENT.search(data, at)
        if found is None or found[1][0] == _END:
            return passes * pixels
        marker, at = found[1][0], found.end()
        try:
            if marker in FRAME_MARKERS:
                _, _, height, width, channels = _SCAN_FRAME.unpack_from(data, at)
                pixels = max(pixels, component_pixels(height, width))
                all_at_once = channels if marker in _SEQUENTIAL else 0
            elif marker == _SCAN:
                _, components = _SCANNED.unpack_from(data, at)
                passes += int(components)
                if components == all_at_once:  # libjpeg refuses a further scan
                    return passes * pixels
            at += _LENGTH.unpack_from(data, at)[0]
        except struct.error:  # cut off
            return passes * pixels
    raise ValueError(f"a JPEG file of more than {MAX_MARKERS} markers")


def component_pixels(height: int, width: int) -> int:
    """Return the pixels of one component in whole blocks."""
    return math.ceil(height / _BLOCK) * math.ceil(width / _BLOCK) * _BLOCK**2


RAW: Final = "raw"
JPEG: Final = "jpeg"
PNG: Final = "png"
ZSTD: Final = "zstd"

MAX_DECODED_BYTES: Final = 128 * 1024 * 1024
"""The maximum number of bytes that compressed data may expand to."""

MAX_SEGMENTS: Final = 1_024
"""Segments and fill bytes in a JPEG file up to the segment with its size: real files have some dozens, or a few hundred
with a large colour profile. 128 MiB of fill bytes would take a quarter of a minute to read."""

_JPEG_START: Final = b"\xff\xd8"
_PNG_START: Final = b"\x89PNG\r\n\x1a\n\x00\x00\x00\x0dIHDR"
_PNG_SIZE: Final = struct.Struct(">IIBB")
_PNG_ENCODINGS: Final = {(8, 0): "mono8", (16, 0): "mono16", (8, 2): "rgb8", (8, 3): "rgb8", (8, 6): "rgba8"}
MAX_SCANS: Final = 100
"""Passes over all components of a JPEG file. Each takes few bytes in the file, and libjpeg up to 1 ns for each
component-pixel."""

MAX_SCANNED_PIXELS: Final = 10 * MAX_DECODED_BYTES
"""Component-pixels that all scans of a JPEG file go over. Encoders ask for at most six passes over all components."""

_SEGMENT: Final = struct.Struct(">BBH")
_FILL: Final = 0xFF
_WITHOUT_LENGTH: Final = frozenset({0x00, 0x01, *range(0xD0, 0xDA)})
"""Markers after which a decoder does not skip a segment: it would find another size than we do."""
_FRAME: Final = struct.Struct(">BHHB")
_JPEG_ENCODINGS: Final = {1: "mono8", 3: "rgb8"}
_ZSTD_START: Final = b"\x28\xb5\x2f\xfd"
_SINGLE_SEGMENT: Final = 0x20
_RESERVED: Final = 0x08
_DICTIONARY: Final = 0x03
_CONTENT_SIZES: Final = ("<B", "<H", "<I", "<Q")
_TWO_BYTES_ADD: Final = 256


@dataclass(frozen=True, slots=True)
class Picture:
    """A compressed image's format, its size in pixels, and its pixel encoding."""

    format: str
    height: int
    width: int
    encoding: str


def picture_of(data: memoryview) -> Picture:
    """Read the header of a JPEG or PNG file; palettes count as rgb8.

    Raises:
        SchemaError: neither of them, cut off before its size or with too much before it, with pixels that the contract
            does not carry, or made to take long to decode.
    """
    try:
        if is_png(data):
            return _png(data)
        if bytes(data[: len(_JPEG_START)]) == _JPEG_START:
            return _jpeg(data)
    except struct.error as error:
        raise SchemaError(f"a picture cut off at {data.nbytes} bytes") from error
    raise SchemaError(f"neither a JPEG nor a PNG file: it begins with {bytes(data[:8])!r}")


def is_png(data: memoryview) -> bool:
    """Return whether data begins like a PNG file."""
    return bytes(data[: len(_PNG_START)]) == _PNG_START


def _png(data: memoryview) -> Picture:
    width, height, bits, color = _PNG_SIZE.unpack_from(data, len(_PNG_START))
    if (bits, color) not in _PNG_ENCODINGS:
        raise SchemaError(f"a PNG file with {bits} bits and colour type {color}")
    return Picture(PNG, height, width, _PNG_ENCODINGS[bits, color])


def _jpeg(data: memoryview) -> Picture:
    at = len(_JPEG_START)
    for _ in range(MAX_SEGMENTS):
        start, marker, length = _SEGMENT.unpack_from(data, at)
        if start == marker == _FILL:
            at += 1
            continue
        if start != 0xFF or marker in _WITHOUT_LENGTH or length < 2:
            raise SchemaError(f"a JPEG file with {start:#x} {marker:#x} at byte {at}")
        if marker in FRAME_MARKERS:
            _, height, width, channels = _FRAME.unpack_from(data, at + _SEGMENT.size)
            if channels not in _JPEG_ENCODINGS:
                raise SchemaError(f"a JPEG file with {channels} channels")
            _check_scans(data, component_pixels(height, width) * channels)
            return Picture(JPEG, height, width, _JPEG_ENCODINGS[channels])
        at += 2 + length
    raise SchemaError(f"a JPEG file that says no size in its first {MAX_SEGMENTS} segments")


def _check_scans(data: memoryview, once: int) -> None:
    """Reject files that are crafted to decode slowly. once: the component-pixels of one pass over all components."""
    most = max(once, min(MAX_SCANS * once, MAX_SCANNED_PIXELS))
    try:
        scanned = scanned_pixels(data)
    except ValueError as error:
        raise SchemaError(str(error)) from error
    if scanned > most:
        raise SchemaError(f"a JPEG file whose scans go over {scanned} component-pixels, at most {most} are decoded")


def check_zstd(data: memoryview, size: int) -> None:
    """Check that a Zstandard frame (RFC 8878) declares exactly `size` bytes, within limits.

    Raises:
        SchemaError: it does not, or it needs a dictionary or a later decoder.
    """
    if size > MAX_DECODED_BYTES:
        raise SchemaError(f"{size} bytes to be decoded, at most {MAX_DECODED_BYTES} are")
    try:
        held = _content_size(data)
    except (struct.error, IndexError) as error:
        raise SchemaError(f"zstd data cut off at {data.nbytes} bytes") from error
    if held != size:
        raise SchemaError(f"zstd data holds {'an unknown number of' if held is None else held} bytes instead of {size}")


def _content_size(data: memoryview) -> int | None:
    at = len(_ZSTD_START)
    if bytes(data[:at]) != _ZSTD_START:
        raise SchemaError(f"not zstd data: it begins with {bytes(data[:8])!r}")
    described = data[at]
    single, width = bool(described & _SINGLE_SEGMENT), described >> 6
    if described & _RESERVED:
        raise SchemaError("zstd data of a later kind: its header has a reserved bit")
    if described & _DICTIONARY:
        raise SchemaError("zstd data that needs a dictionary")
    if not width and not single:
        return None
    (size,) = struct.unpack_from(_CONTENT_SIZES[width], data, at + (1 if single else 2))
    return int(size) + (_TWO_BYTES_ADD if width == 1 else 0)
