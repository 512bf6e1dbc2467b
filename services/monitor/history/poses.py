"""Where robots were last, of which what changed is written now and then. Pure."""

import math
from collections.abc import Iterator, Mapping
from typing import Final

from services.monitor.mapping.places import Places
from services.monitor.mapping.pose import Pose

WRITE_S: Final = 30.0
"""How often poses are written: robots move all the time."""


class KnownPoses:
    """The poses of a map, and those of them that are not written yet."""

    def __init__(self, places: Places) -> None:
        self._places = places
        self._written: dict[str, Pose] = {}

    def restore(self, poses: Mapping[str, Pose]) -> None:
        """Take those that a store kept."""
        self._written.update(poses)
        self._places.stand(poses)

    def pending(self) -> Iterator[tuple[str, Pose]]:
        """Yield the robots with poses that are to be written; such as no database takes are none."""
        for name, pose in list(self._places.poses.items()):
            if self._written.get(name) is not pose and all(map(math.isfinite, (pose.x, pose.y, pose.yaw))):
                yield name, pose

    def written(self, poses: Mapping[str, Pose]) -> None:
        """Take note that these are written."""
        self._written.update(poses)
