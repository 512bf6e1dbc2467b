"""How much work a JPEG file is to decode: each of its scans goes over the components that it names."""

import math
import re
import struct
from typing import Final

JPEG_START: Final = b"\xff\xd8\xff"
FRAME_MARKERS: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of the segment with the picture's size."""
MAX_MARKERS: Final = 10_000
"""Real files have some dozens, or a few hundred with a large colour profile."""

_SCAN: Final = 0xDA
_END: Final = 0xD9
_SEQUENTIAL: Final = frozenset({0xC0, 0xC1})
_BLOCK: Final = 8
_SEGMENT: Final = re.compile(rb"\xff([\x02-\xcf\xd8-\xfe])")
"""What begins one: coded pixels have a zero after each 0xff, or a marker to restart from, which has no length."""
_LENGTH: Final = struct.Struct(">H")
_FRAME: Final = struct.Struct(">HBHHB")
_SCANNED: Final = struct.Struct(">HB")


def scanned_pixels(data: bytes | memoryview) -> int:
    """Return how many component-pixels a decoder goes over: those of each component of each scan, as libjpeg reads it.

    What is behind the picture's end does not count, nor what is in segments: phones put films and previews there.

    Raises:
        ValueError: the file has more markers than MAX_MARKERS.
    """
    at, passes, pixels, all_at_once = len(JPEG_START) - 1, 0, 0, 0
    for _ in range(MAX_MARKERS):
        found = _SEGMENT.search(data, at)
        if found is None or found[1][0] == _END:
            return passes * pixels
        marker, at = found[1][0], found.end()
        try:
            if marker in FRAME_MARKERS:
                _, _, height, width, channels = _FRAME.unpack_from(data, at)
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
