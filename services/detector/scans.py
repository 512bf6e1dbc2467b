"""How much work a JPEG file is to decode: each of its scans goes over the whole picture. Pure."""

import re
import struct
from typing import Final

JPEG_START: Final = b"\xff\xd8\xff"
SCAN: Final = 0xDA
END: Final = 0xD9
SIZES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
MAX_MARKERS: Final = 10_000
"""Real files have some dozens, or a few hundred with a large colour profile."""

_SEGMENT: Final = re.compile(rb"\xff([\x02-\xcf\xd8-\xfe])")
"""What begins one: coded pixels have a zero after each 0xff, or a marker to restart from, which has no length."""
_LENGTH: Final = struct.Struct(">H")
_FRAME: Final = struct.Struct(">HBHHB")


def scanned_bytes(data: bytes) -> int:
    """Return how many bytes of pixels a decoder goes over, those of the picture once for each scan, as libjpeg reads.

    What is behind the picture's end does not count, nor what is in segments: phones put films and previews there.

    Raises:
        ValueError: the file has more markers than MAX_MARKERS.
    """
    at, scans, size = len(JPEG_START) - 1, 0, 0
    for _ in range(MAX_MARKERS):
        found = _SEGMENT.search(data, at)
        if found is None or found[1][0] == END:
            return scans * size
        marker, at = found[1][0], found.end()
        scans += marker == SCAN
        try:
            if marker in SIZES:
                _, _, height, width, channels = _FRAME.unpack_from(data, at)
                size = max(size, height * width * channels)
            at += _LENGTH.unpack_from(data, at)[0]
        except struct.error:  # cut off
            return scans * size
    raise ValueError(f"a JPEG file of more than {MAX_MARKERS} markers")
