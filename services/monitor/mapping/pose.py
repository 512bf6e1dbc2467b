"""Where a robot is in the map, as its transforms say. Pure."""

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from schemas.transforms import Transforms
from services.geometry.errors import TransformError
from services.geometry.transforms import TransformTree
from services.monitor.mapping.places import MAP

BASES: Final = ("base_link", "base_footprint")
"""What a robot's own frame is called, the usual name first."""

KEEP_NS: Final = 2_000_000_000
STAMPS: Final = 32
"""A pose is of the newest stamp that all transforms on the way to the map know; these many are tried."""


@dataclass(frozen=True, slots=True)
class Pose:
    """x, y in metres in the map; yaw in radians from its x axis, counter-clockwise. at_ns: when it arrived, epoch."""

    x: float
    y: float
    yaw: float
    at_ns: int


class Whereabouts:
    """Where one robot is. why: what is missing while its pose is not known, in words."""

    def __init__(self) -> None:
        self._tree = TransformTree(KEEP_NS)
        self._stamps: deque[int] = deque([0], STAMPS)
        self._at_ns = 0

    def take(self, transforms: Transforms, received_ns: int, *, static: bool) -> None:
        """Take what came on `tf`, or `static`, on `tf_static`."""
        self._tree.take(transforms, static=static)
        if not static:
            self._at_ns = received_ns
            newest = max((each.stamp_ns for each in transforms.transforms), default=0)
            if newest != self._stamps[-1]:
                self._stamps.append(newest)
        self._at_ns = self._at_ns or received_ns

    def pose(self) -> Pose | str:
        """Return the newest pose that is known, or what is missing, in words."""
        missing = "its transforms have not arrived"
        if not self._at_ns:
            return missing
        for base in BASES:
            for stamp_ns in reversed(self._stamps):
                try:
                    found = self._tree.lookup(MAP, base, stamp_ns)
                except TransformError as error:
                    missing = str(error)
                else:
                    yaw = math.atan2(found[1, 0], found[0, 0])
                    return Pose(float(found[0, 3]), float(found[1, 3]), yaw, self._at_ns)
        return missing
