"""What the C library does with the memory of messages that are gone."""

import ctypes
from typing import Final

_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
KEPT_BYTES: Final = 32 << 20


def keep_freed_memory() -> None:
    """Have glibc keep up to KEPT_BYTES of freed memory; nothing where another C library is.

    By default it gives each image's megabyte back to the system, and getting it again page by page costs more than
    copying the image.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, KEPT_BYTES)
        mallopt(_M_TRIM_THRESHOLD, KEPT_BYTES)
