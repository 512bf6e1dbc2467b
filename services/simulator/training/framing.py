"""Views of a scene that show something."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.random import Generator

from services.simulator.training.viewpoints import draw_camera, draw_pose
from services.simulator.world import Camera, Pose, Rendering, Scene, render
from services.simulator.world.clearance import Clearance

MIN_OBJECT_AREA: Final = 0.003
MIN_MEDIAN_DEPTH: Final = 0.8
MAX_TRIES: Final = 6


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What a camera sees from where it is."""

    pose: Pose
    camera: Camera
    rendering: Rendering


def draw_view(scene: Scene, clearance: Clearance, rng: Generator) -> View:
    """Draw views until one shows objects and no wall fills it; after a few the last one must do."""
    view = _any_view(scene, clearance, rng)
    for _ in range(MAX_TRIES - 1):
        if shows_enough(view.rendering):
            break
        view = _any_view(scene, clearance, rng)
    return view


def shows_enough(rendering: Rendering) -> bool:
    """Whether objects cover `MIN_OBJECT_AREA` of the picture and half of it is beyond `MIN_MEDIAN_DEPTH` metres."""
    return bool(np.mean(rendering.instances > 0) > MIN_OBJECT_AREA and np.median(rendering.depth) > MIN_MEDIAN_DEPTH)


def _any_view(scene: Scene, clearance: Clearance, rng: Generator) -> View:
    pose, camera = draw_pose(scene, clearance, rng), draw_camera(rng)
    return View(pose, camera, render(scene, pose, camera))
