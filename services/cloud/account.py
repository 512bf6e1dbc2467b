"""What became of one camera's detections and points. Pure."""

from collections import Counter
from typing import Final

from schemas.keys import CameraKey
from schemas.status import CameraLoad

REPLACED: Final = "replaced by newer detections"
DOUBLE: Final = "the same detections again"
MALFORMED: Final = "malformed detections"
MALFORMED_POINTS: Final = "malformed points"
MALFORMED_INFO: Final = "malformed camera info"
MALFORMED_TRANSFORMS: Final = "malformed transforms"
UNSTAMPED: Final = "points without a stamp"
UNJOINED: Final = "no points of the same instant"
UNPLACED: Final = "points that cannot be brought to the picture"
FAILED: Final = "failed"
UNWANTED: Final = "no longer wanted"


class Account:
    """Counts every message of detections once: measured, or dropped for a reason; and what else was of no use."""

    def __init__(self, camera: CameraKey) -> None:
        self._camera = camera
        self.measured = 0
        self.dropped: Counter[str] = Counter()

    def add(self, what: str, dropped: Counter[str]) -> None:
        """Note what became of things of a kind, by reason, and forget it there."""
        for reason, count in dropped.items():
            self.dropped[f"{what}: {reason}"] += count
        dropped.clear()

    def load(self, *, serving: bool) -> CameraLoad:
        """Return the counts as a message."""
        return CameraLoad(
            robot=self._camera.robot,
            camera=self._camera.camera,
            inferred=self.measured,
            dropped={reason: count for reason, count in self.dropped.items() if count},
            serving=serving,
        )
