"""The frames that every sender sends: 640x480 rgb8, each one written anew, as a camera's driver would."""

import random
import struct
import time
from collections.abc import Iterator
from typing import Final

WIDTH: Final = 640
HEIGHT: Final = 480
STEP: Final = WIDTH * 3
SIZE: Final = HEIGHT * STEP
POOL: Final = 64
"""Frames that are copied from in turn: together more than a processor's cache holds."""

SEED: Final = 7
MARK: Final = b"fleetsight frame"
_SENT: Final = struct.Struct("<Q")


def frames(head: bytes = b"", hz: float = 0) -> Iterator[bytearray]:
    """Yield `head` and new pixels, in the same buffer every time, `hz` times a second or, when it is 0, at once.

    The pixels begin with MARK and the time they were made at, in nanoseconds of the system's clock.
    """
    drawn = random.Random(SEED)  # noqa: S311 - pixels
    pool = [drawn.randbytes(SIZE) for _ in range(POOL)]
    frame = bytearray(head) + bytearray(SIZE)
    pixels = memoryview(frame)[len(head) :]
    number, due = 0, time.monotonic()
    while True:
        if hz:
            due += 1 / hz
            time.sleep(max(0, due - time.monotonic()))
        pixels[:] = pool[number % POOL]
        number += 1
        pixels[: len(MARK)] = MARK
        _SENT.pack_into(pixels, len(MARK), time.time_ns())
        yield frame


def sent_ns(payload: bytes | bytearray) -> int:
    """Return when the pixels that a payload carries were made."""
    (sent,) = _SENT.unpack_from(payload, payload.index(MARK, 0, 4096) + len(MARK))
    return int(sent)
