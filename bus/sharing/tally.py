"""What became of one camera's work at a worker. Pure."""

from collections import Counter

from schemas.keys import CameraKey
from schemas.status import CameraLoad


class Tally:
    """Counts what was measured of a camera, and what was dropped, by reason."""

    def __init__(self, camera: CameraKey) -> None:
        self.camera = camera
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
            robot=self.camera.robot,
            camera=self.camera.camera,
            inferred=self.measured,
            dropped={reason: count for reason, count in self.dropped.items() if count},
            serving=serving,
        )
