"""PNG files of 8- and 16-bit grey and colour pixels (ISO/IEC 15948). Pure."""

import struct
import zlib
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

LEVEL: Final = 1
"""zlib's fastest: a robot's processor is dearer than the last few per cent."""

_START: Final = b"\x89PNG\r\n\x1a\n"
_COLOUR_TYPES: Final = {1: 0, 3: 2, 4: 6}


def encode_png(pixels: NDArray[Any]) -> bytes:
    """Return the file of height x width x 1, 3 or 4 pixels of 8 or 16 bits, grey or red first."""
    height, width, channels = pixels.shape
    bits = pixels.dtype.itemsize * 8
    head = struct.pack(">IIBBBBB", width, height, bits, _COLOUR_TYPES[channels], 0, 0, 0)
    rows = np.ascontiguousarray(pixels, dtype=f">u{bits // 8}").view(np.uint8).reshape(height, -1)
    filtered = _filtered(rows, channels * bits // 8)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(filtered.data, LEVEL)), (b"IEND", b""))
    return _START + b"".join(_chunk(name, data) for name, data in chunks)


def _filtered(rows: NDArray[np.uint8], pixel: int) -> NDArray[np.uint8]:
    """Return each row with its filter's number before it: as it is, less the pixel before, or less the row above.

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
