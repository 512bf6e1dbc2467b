"""Camera poses as a robot would have them: low, outside of things, and mostly with something near in view."""

from typing import Final

import numpy as np
from numpy.random import Generator

from services.simulator.world import CLASSES, Camera, Pose, Scene
from services.simulator.world.clearance import Clearance

ROBOT_RADIUS: Final = 0.3
CLASS_WEIGHTS: Final = dict(zip(CLASSES, (0.27, 0.33, 0.4), strict=True))
AIMED: Final = 0.92


def draw_camera(rng: Generator) -> Camera:
    """A 640x480 camera of some usual field of view."""
    return Camera.with_field_of_view(640, 480, float(rng.uniform(1.0, 1.4)))


def draw_pose(scene: Scene, clearance: Clearance, rng: Generator) -> Pose:
    """A pose in free space, 1 to 6 m from an object on the floor (any object, all classes about alike)."""
    for _ in range(200):
        target = _target(scene, rng)
        distance = float(rng.uniform(1.0, 6.0))
        bearing = float(rng.uniform(-np.pi, np.pi))
        spot = target[:2] - distance * np.array([np.cos(bearing), np.sin(bearing)])
        within = abs(spot[0]) < scene.half_x and abs(spot[1]) < scene.half_y
        if within and clearance.at(spot) > ROBOT_RADIUS:
            return _looking(spot, target, distance, bearing, rng)
    free = np.argwhere(clearance.grid > ROBOT_RADIUS)
    spot = clearance.points(free[int(rng.integers(len(free)))])
    return _looking(spot, np.array([0.0, 0.0, 0.5]), 3.0, float(rng.uniform(-np.pi, np.pi)), rng)


def _target(scene: Scene, rng: Generator) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    centres = scene.instance_centres()
    name = str(rng.choice(list(CLASS_WEIGHTS), p=list(CLASS_WEIGHTS.values())))
    wanted = (scene.instance_classes == CLASSES.index(name)) & (centres[:, 2] < 1.6)
    if rng.random() > AIMED or not wanted.any():
        return np.array([rng.uniform(-1, 1) * scene.half_x, rng.uniform(-1, 1) * scene.half_y, 0.5])
    return np.asarray(centres[rng.choice(np.flatnonzero(wanted))], np.float64)


def _looking(
    spot: np.ndarray[tuple[int], np.dtype[np.float64]],
    target: np.ndarray[tuple[int], np.dtype[np.float64]],
    distance: float,
    bearing: float,
    rng: Generator,
) -> Pose:
    height = float(rng.uniform(0.4, 1.2))
    pitch = float(np.arctan2(target[2] - height, distance)) * 0.6 + float(rng.normal(0, 0.07))
    yaw = bearing + float(rng.normal(0, 0.22))
    return Pose.looking(float(spot[0]), float(spot[1]), height, yaw, pitch)
