"""RVL as its paper describes it, a number at a time: how ROS's compressedDepth transport writes depth."""

import struct
from collections.abc import Iterator
from itertools import groupby

import numpy as np
from numpy.typing import NDArray


def rvl_of(depth: NDArray[np.uint16]) -> bytes:
    """Return an image as the transport writes it behind its own twelve bytes."""
    height, width = depth.shape
    return struct.pack("<II", width, height) + words_of(numbers_of(depth.ravel().tolist()))


def numbers_of(depth: list[int]) -> Iterator[int]:
    """Yield the lengths of runs without and with readings, and behind the latter how far each is from the last."""
    last = 0
    runs = [(bool(reading), list(run)) for reading, run in groupby(depth, bool)]
    if runs and runs[0][0]:
        yield 0
    for is_read, run in runs:
        yield len(run)
        for reading in run if is_read else ():
            step = reading - last
            yield 2 * step if step >= 0 else -2 * step - 1
            last = reading
    if runs and not runs[-1][0]:
        yield 0


def words_of(numbers: Iterator[int]) -> bytes:
    """Return numbers as nibbles of three bits, the lowest first, and eight nibbles a word, the first the highest."""
    nibbles = ""
    for number in numbers:
        octal = f"{number:o}"[::-1]
        nibbles += "".join(f"{int(digit) + 8 * (at < len(octal) - 1):x}" for at, digit in enumerate(octal))
    nibbles += "0" * (-len(nibbles) % 8)
    return b"".join(bytes.fromhex(nibbles[at : at + 8])[::-1] for at in range(0, len(nibbles), 8))
