"""What became of one camera's frames. Pure."""

from collections import Counter
from typing import Final

from schemas.header import Header
from schemas.keys import CameraKey
from schemas.status import MISSING, CameraLoad

REPLACED: Final = "replaced by a newer frame"
MALFORMED: Final = "malformed"
FAILED: Final = "failed in the model"
DEPTH: Final = "a depth image, not a picture"
UNWANTED: Final = "no longer wanted"


class Account:
    """Counts every frame of a camera once: inferred, or dropped for a reason."""

    def __init__(self, camera: CameraKey) -> None:
        self._camera = camera
        self._last: Header | None = None
        self.inferred = 0
        self.dropped: Counter[str] = Counter()

    def begin(self) -> None:
        """Start anew after a pause: the frames of the pause were never meant for us."""
        self._last = None

    def arrived(self, header: Header, replaced: int) -> None:
        """Note a frame, and that the queue replaced `replaced` others before it; the rest of a gap is missing."""
        self.dropped[REPLACED] += replaced
        last, self._last = self._last, header
        if last is not None and last.boot_id == header.boot_id:
            self.dropped[MISSING] += max(0, header.seq - last.seq - 1 - replaced)

    def malformed(self, replaced: int) -> None:
        """Note a frame that says not even its number, so the gap around it says nothing either."""
        self.dropped[REPLACED] += replaced
        self.dropped[MALFORMED] += 1
        self.begin()

    def load(self) -> CameraLoad:
        """Return the counts as a message."""
        return CameraLoad(
            robot=self._camera.robot,
            camera=self._camera.camera,
            inferred=self.inferred,
            dropped={reason: count for reason, count in self.dropped.items() if count},
        )
