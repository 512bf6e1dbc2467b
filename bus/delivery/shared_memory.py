"""Shared memory of one publisher: subscribers on the same machine read its payloads without a copy."""

import logging
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import zenoh
from zenoh.shm import ShmProvider, ZShmMut

from bus.delivery.split_payload import Payload, Pieces, joined
from bus.errors import BusError
from bus.session.panics import panics_are_errors

FRAMES: Final = 3
"""Payloads in transit at once: shared ones fill no socket buffer, which would otherwise bound them."""

MAX_REFUSED_PAYLOADS: Final = 30
READER_TIMEOUT_S: Final = 3.0
"""After so many successive payloads without room, or seconds of them, payloads that subscribers hold are left to them:
a stopped one never frees them, not even when its link counts as lost, which takes 2 s unless told otherwise."""

SMALLEST_BYTES: Final = 4096
"""Smallest payload that is shared: sending a smaller one through a socket is faster."""

_SPARE: Final = 16
"""1 / _SPARE is added to the size, so that slightly larger headers do not move the room each time."""

_OVERHEAD_BYTES: Final = 4096

_OWN_BYTES: Final = 2 << 20
"""Memory that Zenoh takes once for its bookkeeping."""

_FOLDER: Final = Path("/dev/shm")  # noqa: S108 - where Zenoh has its segments; only its free space is read

_log: Final = logging.getLogger(__name__)


class SharedFrames:
    """Shared room for FRAMES payloads of the largest size so far. Use from one thread at a time. clock: in seconds."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._largest = 0
        self._refused = 0
        self._refused_since = 0.0
        self._provider: ShmProvider | None = None

    def place(self, payload: Payload) -> ZShmMut | bytes | bytearray | None:
        """Return the payload's copy in shared memory, or the payload itself if it is small or memory is short.

        None while subscribers hold all the room: the payload is to be dropped. One that stands still holds up the
        stream's others for less than MAX_REFUSED_PAYLOADS payloads and READER_TIMEOUT_S.
        """
        size = len(payload)
        if size < SMALLEST_BYTES:
            return joined(payload)
        if size > self._largest:
            self._renew(size + size // _SPARE)
        if self._provider is None:
            return joined(payload)
        if (room := _allocated(self._provider, size)) is not None:
            self._refused = 0
            _write(payload, room)
            return room
        if not self._refused:
            self._refused_since = self._clock()
        self._refused += 1
        if not self._is_impatient():
            return None
        self._renew(self._largest)
        return self.place(payload)

    def _is_impatient(self) -> bool:
        return self._refused >= MAX_REFUSED_PAYLOADS or self._clock() >= self._refused_since + READER_TIMEOUT_S

    def _renew(self, largest: int) -> None:
        self._largest = largest
        self._refused = 0
        self._provider = None  # its memory is freed once no subscriber holds it
        self._provider = _provider(FRAMES * (largest + _OVERHEAD_BYTES))


def _write(payload: Payload, room: ZShmMut) -> None:
    if isinstance(payload, Pieces):
        payload.write(room)
    else:
        room[0 : len(payload)] = payload


def _allocated(provider: ShmProvider, size: int) -> ZShmMut | None:
    # Zenoh's own policies (1.10) give up where no single piece that came back is large enough.
    provider.garbage_collect()
    try:
        return provider.alloc(size)
    except zenoh.ZError:
        provider.defragment()
    try:
        return provider.alloc(size)
    except zenoh.ZError:
        return None


def _provider(size: int) -> ShmProvider | None:
    """Return new shared memory, if the system has room for twice as much: half is left to other processes."""
    try:
        free = os.statvfs(_FOLDER)
        if free.f_bavail * free.f_frsize >= 2 * size + _OWN_BYTES:
            with panics_are_errors():
                provider = ShmProvider.default_backend(size)
                provider.alloc(1)  # with the first allocation, Zenoh takes its bookkeeping memory
            return provider
        reason = f"{_FOLDER} is too full"
    except (OSError, zenoh.ZError, BusError) as error:
        reason = str(error)
    _log.warning("no shared memory for %d bytes (%s): such messages go through sockets", size, reason)
    return None
