"""Memory of the process: how much of it may be locked for sharing, and how the C allocator returns it."""

import ctypes
import mmap
import resource
from contextlib import suppress
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


SHAREABLE_BYTES: Final = 512 << 20
"""What a process must be able to lock before it shares any: room for a few dozen cameras."""

_MLOCK_ONFAULT: Final = 1
"""Locks pages as they are touched: asks for leave without taking the memory."""


def may_lock(size: int) -> bool:
    """Return whether this process may lock so many bytes, once its limit (`ulimit -l`) is raised as far as may be."""
    _, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (hard, hard))
    mlock2 = getattr(ctypes.CDLL(None), "mlock2", None)
    try:
        memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError:  # where the system promises no more than it has
        return False
    with memory:
        start = ctypes.c_char.from_buffer(memory)
        granted = mlock2 is not None and mlock2(ctypes.byref(start), ctypes.c_size_t(size), _MLOCK_ONFAULT) == 0
        del start
    return granted
