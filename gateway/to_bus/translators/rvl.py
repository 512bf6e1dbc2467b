"""RVL, the lossless depth codec of ROS's compressedDepth transport (Wilson, "Fast Lossless Depth Image Compression").

Numbers are nibbles of three bits, the lowest first, each with a bit for whether more follow; eight nibbles are a word,
the first in its highest bits. The numbers are runs: how many pixels without a reading, how many with one, and for each
of these how far it is from the reading before.
"""

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.errors import SchemaError
from schemas.image import MAX_SIDE

MAX_PIXELS: Final = 1 << 23
"""Most pixels to decode: more than any depth camera has, and at most a second of decoding."""

MAX_NIBBLES: Final = 10
"""Most nibbles of a number, for the codec's 32 bits."""

_SIZE: Final = struct.Struct("<II")
_MORE: Final = 8


def decode_rvl(data: memoryview) -> NDArray[np.uint16]:
    """Return the height x width values of an image in the transport's layout: width, height, words.

    Raises:
        SchemaError: it is cut off or damaged, or larger than depth images are.
    """
    if len(data) < _SIZE.size:
        raise SchemaError(f"an RVL image cut off at {len(data)} bytes")
    width, height = _SIZE.unpack_from(data)
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_PIXELS):
        raise SchemaError(f"an RVL image of {width}x{height} pixels, at most {MAX_PIXELS} are decoded")
    count = width * height
    numbers = _numbers(data[_SIZE.size :], most=2 * count + 2 * _MORE)
    made = np.zeros(count, np.uint16)
    runs = _runs(numbers, count)
    made[_inside(runs, count)] = _readings(numbers, runs)
    return made.reshape(height, width)


def _numbers(data: memoryview, most: int) -> NDArray[np.uint32]:
    words = np.frombuffer(data[: len(data) // 4 * 4], "<u4").byteswap().view(np.uint8)
    nibbles = np.empty(2 * len(words), np.uint8)
    nibbles[0::2], nibbles[1::2] = words >> 4, words & 0xF
    if np.count_nonzero(nibbles < _MORE) > most:
        raise SchemaError(f"an RVL image with more than {most} numbers")
    ends = np.flatnonzero(nibbles < _MORE)
    starts = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
    nibbles &= _MORE - 1
    made: NDArray[np.uint32] = nibbles[starts].astype(np.uint32)
    longer = np.flatnonzero(ends > starts)
    for place in range(1, MAX_NIBBLES):
        if not len(longer):
            return made
        made[longer] |= nibbles[starts[longer] + place].astype(np.uint32) << (3 * place)
        longer = longer[ends[longer] > starts[longer] + place]
    if len(longer):
        raise SchemaError(f"an RVL image with a number of more than {MAX_NIBBLES} nibbles")
    return made


def _runs(numbers: NDArray[np.uint32], count: int) -> NDArray[np.int64]:
    """Return the index of the first number, the first pixel and the length of each run of readings."""
    said, end = memoryview(numbers), len(numbers)  # type: ignore[arg-type]
    runs: list[tuple[int, int, int]] = []
    at = pixel = 0
    while pixel < count:
        if at + 2 > end:
            raise SchemaError(f"an RVL image cut off after {pixel} of {count} pixels")
        pixel += said[at]
        length = said[at + 1]
        at += 2
        runs.append((at, pixel, length))
        pixel += length
        at += length
    if pixel > count or at > end:
        raise SchemaError(f"an RVL image with runs over {pixel} pixels of {count}, and {at} numbers of {end}")
    return np.array(runs, np.int64)


def _inside(runs: NDArray[np.int64], count: int) -> NDArray[np.bool_]:
    """Return the mask of pixels that have a reading."""
    _, begins, lengths = runs[runs[:, 2] > 0].T
    steps = np.zeros(count + 1, np.int8)
    steps[begins] += 1
    steps[begins + lengths] -= 1
    return steps[:count].cumsum(dtype=np.int8).view(np.bool_)


def _readings(numbers: NDArray[np.uint32], runs: NDArray[np.int64]) -> NDArray[np.uint16]:
    """Return the readings of all runs, skipping the two numbers before each run."""
    is_step = np.ones(len(numbers), np.bool_)
    is_step[runs[:, 0] - 1] = is_step[runs[:, 0] - 2] = False
    steps = numbers[is_step][: runs[:, 2].sum()]
    return ((steps >> 1) ^ -(steps & 1)).astype(np.uint16).cumsum(dtype=np.uint16)
