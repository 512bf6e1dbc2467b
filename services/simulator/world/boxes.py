"""Upright boxes around objects, in the map or as a camera sees them."""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from services.simulator.world.camera import Pose
from services.simulator.world.cuboids import CORNER_SIGNS, Cuboids
from services.simulator.world.scene import Scene

Points = NDArray[np.float64]
MAP_UP: Final = (0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A box whose height runs along `up`, a unit vector, in some frame of reference.

    `centre` (3,) and `size` (length, width, height) are metres. `yaw` is radians from the frame's x axis, made level,
    to the length; counter-clockwise seen from above.
    """

    centre: Points
    size: Points
    yaw: float
    up: Points

    @classmethod
    def around(cls, points: Points, yaw: float) -> Self:
        """The smallest box of that yaw around map points (n, 3)."""
        axes = _axes(yaw, np.array(MAP_UP))
        local = points @ axes
        low, high = local.min(axis=0), local.max(axis=0)
        return cls(axes @ (low + high) / 2, high - low, yaw, np.array(MAP_UP))

    def clipped(self, points: Points) -> Points:
        """Points (n, 3) of the box's frame, those outside of it moved to its surface."""
        local = (points - self.centre) @ self.axes
        return np.asarray(np.clip(local, -self.size / 2, self.size / 2) @ self.axes.T + self.centre)

    @property
    def axes(self) -> Points:
        """The box's own axes in the frame, one each column: length, width, height."""
        return _axes(self.yaw, self.up)

    def corners(self) -> Points:
        """The corners (8, 3), in the order of `CORNER_SIGNS`."""
        return np.asarray(CORNER_SIGNS * self.size / 2 @ self.axes.T + self.centre)

    def seen_from(self, pose: Pose) -> Self:
        """The same box, of the map, in the frame that is at `pose`, whose x axis must not be upright."""
        rotation = pose.rotation.astype(np.float64)
        up, length = self.up @ rotation, self.axes[:, 0] @ rotation
        level = _axes(0.0, up)
        yaw = float(np.arctan2(length @ level[:, 1], length @ level[:, 0]))
        return type(self)((self.centre - pose.position) @ rotation, self.size, yaw, up)


def _axes(yaw: float, up: Points) -> Points:
    level = np.array([1.0, 0, 0]) - up[0] * up
    level /= np.linalg.norm(level)
    length = np.cos(yaw) * level + np.sin(yaw) * np.cross(up, level)
    return np.stack([length, np.cross(up, length), up], axis=1)


def parts_of(scene: Scene, instance: int) -> Cuboids:
    """The cuboids that an object is made of."""
    return scene.cuboids.taken(np.flatnonzero(scene.cuboids.instances == instance))


def _heading(parts: Cuboids) -> float:
    """The yaw of an object's own axes: those of its first part."""
    x, y, _ = parts.rotations[0, :, 1].astype(np.float64)
    return float(np.arctan2(-x, y))


def box_of(parts: Cuboids) -> Box:
    """The upright box around a whole object in the map, along its own axes, however little of it is in view."""
    return Box.around(parts.corners().reshape(-1, 3).astype(np.float64), _heading(parts))
