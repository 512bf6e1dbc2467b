"""What became of one camera's detections, and of what is kept to measure them with. Pure."""

from typing import Final

from bus.sharing.tally import Tally
from schemas.header import Header
from schemas.keys import CameraKey

DOUBLE: Final = "the same detections again"
REPLACED: Final = "replaced by newer detections"
UNJOINED: Final = "no depth image of the same instant"
FAILED: Final = "failed while measuring"
STAMPLESS: Final = "without a stamp"
TOO_MANY: Final = "too many at once"


class Account(Tally):
    """Counts every image whose objects were detected once: measured, or dropped for a reason, which is said too."""

    def __init__(self, camera: CameraKey) -> None:
        super().__init__(camera)
        self._last: tuple[str, int] | None = None

    def is_new(self, header: Header) -> bool:
        """Return whether an image is another one than the last; the same one again is counted as dropped."""
        last, self._last = self._last, (header.boot_id, header.seq)
        self.dropped[DOUBLE] += last == self._last
        return last != self._last

    def malformed(self, what: str) -> None:
        """Note a message that cannot be read."""
        self.dropped[f"malformed {what}"] += 1
