"""Reads depth images of any encoding as metres."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.compression import PNG, RAW, ZSTD
from schemas.image import BYTES_PER_PIXEL, DEPTH_ENCODINGS, ImageFrame
from services.geometry.decompression import decompressed
from services.geometry.errors import DepthError

Floats = NDArray[np.float32]

MAX_PIXELS: Final = 1 << 24
"""Pixels of the largest depth image that is read: a PNG of a few kilobytes can stand for all that a message may."""

_MILLIMETRES: Final = np.float32(1000)
"""Millimetres per metre; a divisor, so that exact millimetres are rounded once."""

_LIMITS: Final = np.finfo(np.float32)
_NUMBERS: Final = np.arange(1 << 16, dtype=np.uint16)
_EVERYWHERE: Final = (slice(None), slice(None))


@dataclass(frozen=True, slots=True, eq=False)
class Depth:
    """A depth image, height x width, converted to metres only where requested.

    numbers: of its pixels. table: the metres that each number of 16 bits stands for, None where numbers are metres
    themselves; NaN for no reading.
    """

    numbers: NDArray[Any]
    table: Floats | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        height, width = self.numbers.shape
        return height, width

    def metres(self, place: tuple[slice, slice] = _EVERYWHERE) -> Floats:
        """Return metres along the optical axis in these rows and columns, NaN for no reading. Read only."""
        numbers = self.numbers[place]
        if self.table is None:
            return numbers
        if not numbers.size:
            return np.empty(numbers.shape, np.float32)
        return np.asarray(cv2.LUT(np.ascontiguousarray(numbers, np.uint16), self.table))

    def metres_of(self, pixels: NDArray[np.intp]) -> Floats:
        """Return metres of pixels, by their flat places in the image (the nearest, if outside), as `metres` does."""
        numbers = self.numbers.reshape(-1).take(pixels, mode="clip")
        return numbers if self.table is None else self.table.take(numbers)


def read_depth(frame: ImageFrame, *, nearest_m: float = 0.0, farthest_m: float = np.inf) -> Depth:
    """Read a depth image; values beyond the limits are no readings.

    Unit and missing readings are what the encoding says: 16UC1 is millimetres with 0 for none, 32FC1 metres. 0 and what
    is negative or infinite is never a reading.

    Raises:
        DepthError: it is no depth image, or too large.
        GeometryError: its data is damaged.
    """
    if frame.encoding not in DEPTH_ENCODINGS:
        raise DepthError(f"an image in {frame.encoding[:32]}, which is no depth")
    if frame.height * frame.width > MAX_PIXELS:
        raise DepthError(f"depth of {frame.width}x{frame.height} pixels, at most {MAX_PIXELS} are read")
    values = _decoded(frame) if frame.format not in {RAW, ZSTD} else _values(frame)
    if values.dtype.itemsize == _NUMBERS.itemsize:
        return Depth(values, _metres_of_numbers(frame.inverse_depth, nearest_m, farthest_m))
    return Depth(_within(values.astype(np.float32), nearest_m, farthest_m))


@lru_cache(maxsize=8)
def _metres_of_numbers(inverse_depth: tuple[float, float] | None, nearest_m: float, farthest_m: float) -> Floats:
    """Return the metres for each 16 bit value."""
    if inverse_depth is None:
        return _within(_NUMBERS.astype(np.float32) / _MILLIMETRES, nearest_m, farthest_m)
    scale, offset = inverse_depth
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        metres = (scale / (_NUMBERS.astype(np.float64) - offset)).astype(np.float32)
    metres[0] = np.nan
    return _within(metres, nearest_m, farthest_m)


def _within(metres: Floats, nearest_m: float, farthest_m: float) -> Floats:
    """Set values beyond the limits and missing readings to NaN."""
    near, far = max(np.float32(nearest_m), _LIMITS.tiny), min(np.float32(farthest_m), _LIMITS.max)
    beyond = metres < near
    beyond |= metres > far
    np.copyto(metres, np.nan, where=beyond)
    return metres


def _values(frame: ImageFrame) -> NDArray[Any]:
    data = frame.data if frame.format == RAW else decompressed(frame.data, frame.step * frame.height)
    size = BYTES_PER_PIXEL[frame.encoding]
    rows = np.frombuffer(data, np.uint8).reshape(frame.height, frame.step)[:, : frame.width * size]
    kind = "f4" if frame.encoding == "32FC1" else "u2"
    return rows.view(f"{'>' if frame.is_bigendian else '<'}{kind}")


def _decoded(frame: ImageFrame) -> NDArray[Any]:
    if frame.format != PNG:
        raise DepthError(f"depth as {frame.format[:32]}, which is lossy")
    try:
        pixels = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DepthError("a png that cannot be decoded") from error
    if pixels is None or pixels.shape != (frame.height, frame.width) or pixels.dtype != np.uint16:
        raise DepthError("a png that cannot be decoded")
    return np.asarray(pixels)
