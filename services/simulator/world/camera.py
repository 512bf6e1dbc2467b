"""The pinhole camera and its pose."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera without distortion; pixel (0, 0) is the centre of the upper left pixel."""

    width: int = 640
    height: int = 480
    fx: float = 465.6
    fy: float = 465.6
    cx: float = 319.5
    cy: float = 239.5

    @classmethod
    def with_field_of_view(cls, width: int, height: int, horizontal_rad: float) -> Self:
        """A camera of square pixels whose image is centred and `horizontal_rad` wide."""
        focal = width / 2 / float(np.tan(horizontal_rad / 2))
        return cls(width=width, height=height, fx=focal, fy=focal, cx=(width - 1) / 2, cy=(height - 1) / 2)


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """The pose of a frame, mostly a camera's optical one (x right, y down, z forward), in the map (z up), in metres."""

    position: Floats
    rotation: Floats

    @classmethod
    def looking(cls, x: float, y: float, z: float, yaw: float, pitch: float = 0.0) -> Self:
        """A level camera at (x, y, z) that looks along `yaw` (about map z), `pitch` radians above the horizon."""
        forward = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
        right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
        rotation = np.stack([right, np.cross(forward, right), forward], axis=1)
        return cls(np.array([x, y, z], np.float32), rotation.astype(np.float32))

    @classmethod
    def upright(cls, x: float, y: float, z: float, yaw: float) -> Self:
        """An upright frame (x ahead along `yaw`, y left, z up) at (x, y, z), as robots and lidars have it."""
        cos, sin = np.cos(yaw), np.sin(yaw)
        rotation = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], np.float32)
        return cls(np.array([x, y, z], np.float32), rotation)

    def to_map(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (..., 3) of the frame in the map."""
        return np.asarray(points @ self.rotation.T.astype(np.float64) + self.position)
