"""Upright boxes."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.objects import UprightBox
from schemas.world import WorldObject

_UPRIGHT: Final = 0.9
_SHORTEST: Final = 1e-6


def level_of(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a frame's x axis made level, a unit vector like `up`; its z axis if x is upright."""
    first = np.eye(3)[0 if abs(up[0]) < _UPRIGHT else 2]
    level = first - up * (up @ first)
    return np.asarray(level / np.linalg.norm(level))


def axes_of(box: UprightBox) -> NDArray[np.float64]:
    """Return the unit vectors along a box's length, width and height, one row each; without `up`, z is up."""
    length = np.linalg.norm(box.up)
    up = np.array(box.up) / length if length > _SHORTEST else np.array([0.0, 0.0, 1.0])
    level = level_of(up)
    along = np.cos(box.yaw) * level + np.sin(box.yaw) * np.cross(up, level)
    return np.array([along, np.cross(up, along), up])


def is_itself(of: WorldObject, robot: str, at: Sequence[float], margin_m: float = 0.0) -> bool:
    """Return whether an object is a robot as others see it: its class moves, and its box is around the robot's place.

    One that the robot sees itself is something else, however near it is. at: the robot's x and y in the map, metres.
    """
    if of.velocity is None or any(seer.robot == robot for seer in of.seen_by):
        return False
    x, y, yaw = at[0] - of.at[0], at[1] - of.at[1], of.yaw or 0.0
    along, across = x * math.cos(yaw) + y * math.sin(yaw), y * math.cos(yaw) - x * math.sin(yaw)
    return abs(along) <= of.size[0] / 2 + margin_m and abs(across) <= of.size[1] / 2 + margin_m
