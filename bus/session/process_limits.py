"""Limits of the process: open files, of which each link is one, locked memory, and what the C allocator keeps."""

import ctypes
import mmap
import resource
from contextlib import suppress
from typing import Final

from bus.session.link_use import MOST_FILES


def raise_file_limit() -> int:
    """Raise the soft limit of open files (`ulimit -n`) to the hard one, at most MOST_FILES; return the new limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = min(_finite(hard), MOST_FILES)
    if wanted > _finite(soft):
        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return _finite(resource.getrlimit(resource.RLIMIT_NOFILE)[0])


def _finite(limit: int) -> int:
    return MOST_FILES if limit == resource.RLIM_INFINITY else limit


_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
KEPT_BYTES: Final = 32 << 20


def keep_freed_memory() -> None:
    """Let glibc keep up to KEPT_BYTES of freed memory; does nothing with another C library.

    By default it gives each image's megabyte back to the system, and getting it again page by page costs more than
    copying the image.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, KEPT_BYTES)
        mallopt(_M_TRIM_THRESHOLD, KEPT_BYTES)


SHAREABLE_BYTES: Final = 512 << 20
"""Memory that a process must be able to lock before it uses shared memory: room for a few dozen cameras."""

_MLOCK_ONFAULT: Final = 1
"""Locks pages when they are touched: tests the permission without taking the memory."""


def may_lock(size: int) -> bool:
    """Raise the limit of locked memory (`ulimit -l`) as far as allowed; return whether so many bytes fit."""
    _, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (hard, hard))
    mlock2 = getattr(ctypes.CDLL(None), "mlock2", None)
    try:
        memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError:  # where the system does not overcommit memory
        return False
    with memory:
        start = ctypes.c_char.from_buffer(memory)
        granted = mlock2 is not None and mlock2(ctypes.byref(start), ctypes.c_size_t(size), _MLOCK_ONFAULT) == 0
        del start
    return granted
