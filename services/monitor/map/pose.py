"""A robot's pose in the map, from its transforms or the places of the objects it sees. Pure."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from schemas.distances import Distances
from schemas.transforms import Transforms
from services.geometry.errors import TransformError
from services.geometry.transforms import TransformTree

MAP: Final = "map"
BASES: Final = ("base_link", "base_footprint")
"""Names of a robot's base frame, the usual one first."""

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


@dataclass(frozen=True, slots=True)
class DrawnRobot:
    """A robot to draw. live: its pose is current."""

    name: str
    pose: Pose
    live: bool


APART_M: Final = 0.3
"""Minimum distance of two objects that tells a robot's heading; their places are one measurement in two frames."""


def pose_of(distances: Distances, at_ns: int) -> Pose | None:
    """Return a robot's pose from two objects whose places are known both in its own frame and in the map.

    Robots are taken to stand upright. None where it cannot be known.
    """
    known = list(_in_both(distances))
    if not known:
        return None
    (x, y), (east, north) = known[0]
    far, there = max(known, key=lambda each: math.dist(each[0], (x, y)))
    if math.dist(far, (x, y)) < APART_M:
        return None
    yaw = math.atan2(there[1] - north, there[0] - east) - math.atan2(far[1] - y, far[0] - x)
    yaw = math.remainder(yaw, math.tau)
    along, across = math.cos(yaw), math.sin(yaw)
    return Pose(east - along * x + across * y, north - across * x - along * y, yaw, at_ns)


def _in_both(distances: Distances) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    for each in distances.objects:
        places = each.measured.places if each.measured is not None else ()
        at = {place.frame_id.removeprefix("/"): place.at for place in places if place.at is not None}
        base = next((at[name] for name in BASES if name in at), None)
        if base is not None and MAP in at:
            yield base[:2], at[MAP][:2]


class Whereabouts:
    """The pose of one robot. why: the missing transform in words, while there is no pose."""

    def __init__(self) -> None:
        self._tree = TransformTree(KEEP_NS)
        self._stamps: deque[int] = deque([0], STAMPS)
        self._at_ns = 0

    def take(self, transforms: Transforms, received_ns: int, *, static: bool) -> None:
        """Take a message of `tf`, or, if `static`, of `tf_static`."""
        self._tree.take(transforms, static=static)
        if not static:
            self._at_ns = received_ns
            newest = max((each.stamp_ns for each in transforms.transforms), default=0)
            if newest != self._stamps[-1]:
                self._stamps.append(newest)
        self._at_ns = self._at_ns or received_ns

    def pose(self) -> Pose | str:
        """Return the newest known pose, or in words what is missing."""
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
