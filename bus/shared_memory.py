"""One publisher's payloads in memory that subscribers on the same machine read without a copy in between."""

import logging
import os
from pathlib import Path
from typing import Final

import zenoh
from zenoh.shm import GarbageCollect, ShmProvider, ZShmMut

FRAMES: Final = 3
"""Payloads that may be on their way at once: shared ones fill no socket, so that nothing else would bound them."""

SMALLEST_BYTES: Final = 4096
"""A smaller payload is sent sooner than it is shared."""

_SPARE: Final = 16
"""A part of so much is added, so that headers which grow by a byte do not move the room each time."""

_OVERHEAD_BYTES: Final = 4096
_FOLDER: Final = Path("/dev/shm")  # noqa: S108 - where Zenoh has its segments; only its free space is read

_log: Final = logging.getLogger(__name__)


class SharedFrames:
    """Has room for FRAMES times the largest payload it saw. To be used by one thread at a time."""

    def __init__(self) -> None:
        self._largest = 0
        self._provider: ShmProvider | None = None

    def place(self, payload: bytes | bytearray) -> ZShmMut | bytes | bytearray | None:
        """Return the payload's copy in shared memory, or itself where it is small or the system has no room.

        None while subscribers hold all the room: the payload is to be dropped. One that stands still holds up the
        stream's others until its link counts as lost.
        """
        size = len(payload)
        if size < SMALLEST_BYTES:
            return payload
        if size > self._largest:
            self._largest = size + size // _SPARE
            self._provider = _provider(FRAMES * (self._largest + _OVERHEAD_BYTES))
        if self._provider is None:
            return payload
        try:
            room = self._provider.alloc(size, GarbageCollect())
        except zenoh.ZError:
            return None
        room[0:size] = payload
        return room


def _provider(size: int) -> ShmProvider | None:
    """Return fresh shared memory, if the system can back it: writing to what it cannot would end the process."""
    try:
        free = os.statvfs(_FOLDER)
        if free.f_bavail * free.f_frsize >= 2 * size:
            return ShmProvider.default_backend(size)
        reason = f"{_FOLDER} is too full"
    except (OSError, zenoh.ZError) as error:
        reason = str(error)
    _log.warning("no shared memory for %d bytes (%s): such messages are sent instead", size, reason)
    return None
