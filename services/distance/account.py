"""What became of one camera's detections, and of what is kept to measure them with. Pure."""

from collections import Counter
from typing import Final

from schemas.header import Header
from schemas.keys import CameraKey
from schemas.status import CameraLoad

DOUBLE: Final = "the same detections again"
REPLACED: Final = "replaced by newer detections"
UNWANTED: Final = "no longer wanted"
FAILED: Final = "failed while measuring"
STAMPLESS: Final = "without a stamp"
TOO_MANY: Final = "too many at once"


class Account:
    """Counts every image whose objects were detected once: measured (also as unknown), or dropped for a reason."""

    def __init__(self, camera: CameraKey) -> None:
        self.camera = camera
        self._last: tuple[str, int] | None = None
        self.measured = 0
        self.dropped: Counter[str] = Counter()

    def is_new(self, header: Header) -> bool:
        """Return whether an image is another one than the last; the same one again is counted as dropped."""
        last, self._last = self._last, (header.boot_id, header.seq)
        self.dropped[DOUBLE] += last == self._last
        return last != self._last

    def malformed(self, what: str) -> None:
        """Note a message that cannot be read."""
        self.dropped[f"malformed {what}"] += 1

    def add(self, what: str, dropped: Counter[str]) -> None:
        """Note what became of things of a kind, by reason, and forget it there."""
        for reason, count in dropped.items():
            self.dropped[f"{what}: {reason}"] += count
        dropped.clear()

    def load(self, *, serving: bool) -> CameraLoad:
        """Return the counts as a message."""
        return CameraLoad(
            robot=self.camera.robot,
            camera=self.camera.camera,
            inferred=self.measured,
            dropped={reason: count for reason, count in self.dropped.items() if count},
            serving=serving,
        )
