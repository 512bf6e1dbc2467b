"""Places sensors on a robot, with frames named as by RealSense's and Velodyne's drivers. Pure.

A placement is a 4 x 4 matrix (float64, metres) that takes points of a frame to its parent's.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.simulator.world import Pose

Placement = NDArray[np.float64]

MAP: Final = "map"
ODOM: Final = "odom"
BASE: Final = "base_link"
CAMERA: Final = "camera_link"
COLOR: Final = "camera_color_frame"
COLOR_OPTICAL: Final = "camera_color_optical_frame"
DEPTH: Final = "camera_depth_frame"
DEPTH_OPTICAL: Final = "camera_depth_optical_frame"
LIDAR: Final = "velodyne"

CAMERA_FORWARD_M: Final = 0.15
COLOR_LEFT_M: Final = 0.015
"""Distance between a D435's colour sensor and its depth sensor."""
LIDAR_ABOVE_CAMERA_M: Final = 0.3
ODOMETRY_ERROR_M: Final = 0.2
ODOMETRY_ERROR_RAD: Final = 0.05


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0, *, yaw: float = 0.0, pitch: float = 0.0) -> Placement:
    """A frame at (x, y, z), rotated by `yaw` about z and then by `pitch` about its y: positive is down, as in ROS."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    return np.array([[cy * cp, -sy, cy * sp, x], [sy * cp, cy, sy * sp, y], [-sp, 0, cp, z], [0, 0, 0, 1]], np.float64)


OPTICAL: Final = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)
"""An optical frame (x right, y down, z forward) in its body frame (x forward, y left, z up)."""


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """The mount of a robot's sensors: parent frame and placement of each frame."""

    joints: Mapping[str, tuple[str, Placement]]

    def on_robot(self, frame: str) -> Placement:
        """The pose of a frame in `base_link`."""
        found = np.eye(4)
        while frame != BASE:
            frame, joint = self.joints[frame]
            found = joint @ found
        return found

    def static(self) -> list[tuple[str, str, Placement]]:
        """Each joint as parent, child, and pose of the child in the parent."""
        return [(parent, child, joint) for child, (parent, joint) in self.joints.items()]


def rig(camera_height: float, camera_pitch: float) -> Rig:
    """The sensors of a robot with a camera at this height (metres) and this pitch above level (radians)."""
    return Rig(
        {
            CAMERA: (BASE, at(CAMERA_FORWARD_M, 0, camera_height, pitch=-camera_pitch)),
            DEPTH: (CAMERA, np.eye(4)),
            DEPTH_OPTICAL: (DEPTH, OPTICAL),
            COLOR: (CAMERA, at(y=COLOR_LEFT_M)),
            COLOR_OPTICAL: (COLOR, OPTICAL),
            LIDAR: (BASE, at(z=camera_height + LIDAR_ABOVE_CAMERA_M)),
        }
    )


def of_pose(pose: Pose) -> Placement:
    """The pose of an optical frame in the map."""
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = pose.rotation, pose.position
    return found


def to_pose(placement: Placement) -> Pose:
    """The camera pose to render from, for a sensor's placement in the map."""
    return Pose(placement[:3, 3].astype(np.float32), placement[:3, :3].astype(np.float32))


def odometry_error(fraction: float) -> Placement:
    """The pose of `odom` in the map after `fraction` of a round: it drifts, and returns at the round's end."""
    turn = 2 * np.pi * fraction
    drift = ODOMETRY_ERROR_M * np.sin(turn)
    return at(drift, ODOMETRY_ERROR_M * (1 - np.cos(turn)), yaw=ODOMETRY_ERROR_RAD * np.sin(turn))
