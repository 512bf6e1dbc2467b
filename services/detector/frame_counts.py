"""Counts of one camera's frames by outcome. Pure."""

from typing import Final

from bus.sharing.work_counts import Tally
from schemas.header import Header, gap
from schemas.keys import CameraKey
from schemas.status import MISSING

REPLACED: Final = "replaced by a newer frame"
STALE: Final = "too old when its turn came"
LATE: Final = "too late on its link"
DOUBLE: Final = "the same frame again"
MALFORMED: Final = "malformed"
FAILED: Final = "failed in the model"
DEPTH: Final = "a depth image, not a picture"
ABOVE_OPINION_RATE: Final = "more than a second opinion asked for"

TOO_MANY: Final = (REPLACED, STALE)
"""Reasons for frames that came faster than they could be processed."""


class FrameCounts(Tally):
    """Counts every frame of a camera once, as done or dropped with a reason.

    unread: why those are dropped that a newer one replaced before they were read.
    """

    def __init__(self, camera: CameraKey, *, unread: str = REPLACED) -> None:
        super().__init__(camera)
        self._unread = unread
        self._last: Header | None = None

    def begin(self) -> None:
        """Restart after a pause; frames sent during the pause are not counted as missing."""
        self._last = None

    def arrived(self, header: Header, replaced: int) -> bool:
        """Count a frame and the `replaced` queued frames before it; the rest of the gap is missing.

        Returns:
            False for the same frame again, which is counted as dropped.
        """
        self.dropped[self._unread] += replaced
        last, self._last = self._last, header
        if last is None or last.boot_id != header.boot_id:
            return True
        self.dropped[MISSING] += max(0, gap(last.seq, header.seq) - replaced)
        self.dropped[DOUBLE] += header.seq == last.seq
        return header.seq != last.seq

    def malformed(self, replaced: int) -> None:
        """Count a frame without a number; the gap around it is not counted."""
        self.dropped[self._unread] += replaced
        self.dropped[MALFORMED] += 1
        self.begin()

    @property
    def too_many(self) -> int:
        """Number of frames dropped because they came faster than they could be processed."""
        return sum(self.dropped[reason] for reason in TOO_MANY)
