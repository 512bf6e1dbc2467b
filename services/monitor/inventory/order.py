"""Which frames are news: each is taken once, and none that is older than the last. Pure."""

from typing import Final

from schemas.header import Header

MAX_BOOTS: Final = 4
"""How many of a gateway's processes are remembered; what an outlived one sent is late."""


class FrameOrder:
    """Knows the newest frame of one stream by its identity: boot id and seq, never by a stamp."""

    __slots__ = ("_boot_id", "_outlived", "_seq")

    def __init__(self) -> None:
        self._boot_id = ""
        self._seq = -1
        self._outlived: tuple[str, ...] = ()

    def take(self, header: Header) -> bool:
        """Return whether the frame is newer than all before it, and remember it."""
        if header.boot_id == self._boot_id:
            if header.seq <= self._seq:
                return False
        elif header.boot_id in self._outlived:
            return False
        else:
            self._outlived = (self._boot_id, *self._outlived)[: MAX_BOOTS - 1]
            self._boot_id = header.boot_id
        self._seq = header.seq
        return True
