"""Draws camera poses as of a robot: low, in free space, and mostly with an object nearby in view."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from services.simulator.world import CLASSES, Camera, Pose, Rendering, Scene, render
from services.simulator.world.clearance import Clearance

Vector = NDArray[np.float64]
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


def _target(scene: Scene, rng: Generator) -> Vector:
    centres = scene.instance_centres()
    name = str(rng.choice(list(CLASS_WEIGHTS), p=list(CLASS_WEIGHTS.values())))
    wanted = (scene.instance_classes == CLASSES.index(name)) & (centres[:, 2] < 1.6)
    if rng.random() > AIMED or not wanted.any():
        return np.array([rng.uniform(-1, 1) * scene.half_x, rng.uniform(-1, 1) * scene.half_y, 0.5])
    return np.asarray(centres[rng.choice(np.flatnonzero(wanted))], np.float64)


def _looking(
    spot: Vector,
    target: Vector,
    distance: float,
    bearing: float,
    rng: Generator,
) -> Pose:
    height = float(rng.uniform(0.4, 1.2))
    pitch = float(np.arctan2(target[2] - height, distance)) * 0.6 + float(rng.normal(0, 0.07))
    yaw = bearing + float(rng.normal(0, 0.22))
    return Pose.looking(float(spot[0]), float(spot[1]), height, yaw, pitch)


MIN_OBJECT_AREA: Final = 0.003
MIN_MEDIAN_DEPTH: Final = 0.8
MAX_TRIES: Final = 6


@dataclass(frozen=True, slots=True, eq=False)
class CameraView:
    """The view of a camera from its pose."""

    pose: Pose
    camera: Camera
    rendering: Rendering


def draw_view(scene: Scene, clearance: Clearance, rng: Generator) -> CameraView:
    """Draw views until one shows objects and no wall fills it; after a few attempts, return the last one."""
    view = _any_view(scene, clearance, rng)
    for _ in range(MAX_TRIES - 1):
        if shows_enough(view.rendering):
            break
        view = _any_view(scene, clearance, rng)
    return view


def shows_enough(rendering: Rendering) -> bool:
    """Whether objects cover `MIN_OBJECT_AREA` of the image and half of it is beyond `MIN_MEDIAN_DEPTH` metres."""
    return bool(np.mean(rendering.instances > 0) > MIN_OBJECT_AREA and np.median(rendering.depth) > MIN_MEDIAN_DEPTH)


def _any_view(scene: Scene, clearance: Clearance, rng: Generator) -> CameraView:
    pose, camera = draw_pose(scene, clearance, rng), draw_camera(rng)
    return CameraView(pose, camera, render(scene, pose, camera))
