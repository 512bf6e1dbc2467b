"""Which frames are news: each is taken once, and none that is older than the last. Pure."""

from typing import Final

from schemas.header import Header

MAX_BOOTS: Final = 4
"""How many of a gateway's processes are remembered; what an outlived one sent is late."""

QUIET_NS: Final = 3_000_000_000
"""How long the newest process has said nothing when one that it outlived is heard again: it runs on, alone."""


class FrameOrder:
    """Knows the newest frame of one stream by its identity: boot id and seq, never by a stamp."""

    __slots__ = ("_at_ns", "_boot_id", "_outlived", "_seq")

    def __init__(self) -> None:
        self._boot_id = ""
        self._seq = -1
        self._at_ns = 0
        self._outlived: tuple[tuple[str, int], ...] = ()

    def take(self, header: Header, at_ns: int) -> bool:
        """Return whether a frame that came at `at_ns` is newer than all before it, and remember it."""
        if header.boot_id == self._boot_id:
            if header.seq <= self._seq:
                return False
        else:
            last_seq = dict(self._outlived).get(header.boot_id)
            if last_seq is not None and (header.seq <= last_seq or at_ns - self._at_ns <= QUIET_NS):
                return False
            others = [each for each in self._outlived if each[0] != header.boot_id]
            self._outlived = ((self._boot_id, self._seq), *others)[: MAX_BOOTS - 1]
            self._boot_id = header.boot_id
        self._seq, self._at_ns = header.seq, at_ns
        return True

    def set_back(self, now_ns: int) -> None:
        """Have nothing be heard later than now: the clock was set back."""
        self._at_ns = min(self._at_ns, now_ns)
