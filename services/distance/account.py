"""What became of one camera's detections, and of what is kept to measure them with. Pure."""

from typing import Final

from bus.sharing.tally import Tally
from schemas.header import Header, is_newer
from schemas.keys import CameraKey

DOUBLE: Final = "the same detections again, or older ones"
REPLACED: Final = "replaced by newer detections"
UNJOINED: Final = "no depth image of the same instant"
FAILED: Final = "failed while measuring"
STAMPLESS: Final = "without a stamp"
TOO_MANY: Final = "too many at once"


class Account(Tally):
    """Counts every image whose objects were detected once: measured, or dropped for a reason, which is said too."""

    def __init__(self, camera: CameraKey) -> None:
        super().__init__(camera)
        self._last: Header | None = None

    def is_new(self, header: Header) -> bool:
        """Return whether an image is newer than the last; of two workers at a take-over one may be behind the other."""
        new = is_newer(header, self._last)
        if new:
            self._last = header
        else:
            self.dropped[DOUBLE] += 1
        return new

    def malformed(self, what: str) -> None:
        """Note a message that cannot be read."""
        self.dropped[f"malformed {what}"] += 1
