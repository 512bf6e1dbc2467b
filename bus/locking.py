"""How much memory this process may lock: Zenoh locks what it shares, and loses each message whose memory it cannot."""

import ctypes
import mmap
import resource
from contextlib import suppress
from typing import Final

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
