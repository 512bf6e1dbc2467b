"""Pictures of scenes that the shipped model was not trained on."""

import numpy as np
from numpy.typing import NDArray

from services.simulator.world import Camera, Drive, Sensor, expose, generate, render, truth_of
from services.training.evaluation.near_objects import LabelledBox, near_objects

UNSEEN_SEED = 700


def near_view(fraction: float = 0.25, seed: int = UNSEEN_SEED) -> NDArray[np.uint8]:
    """Look at what is near on a drive through an unseen scene: 480 x 640 x 3 in BGR, as Ultralytics takes it."""
    return np.ascontiguousarray(near_view_with_truth(fraction, seed)[0][..., ::-1])


def near_view_with_truth(fraction: float, seed: int = UNSEEN_SEED) -> tuple[NDArray[np.uint8], list[LabelledBox]]:
    """Return the same picture in RGB, and the near objects in it."""
    scene = generate(seed)
    pose, camera = Drive.plan(scene).pose(fraction), Camera()
    seen = render(scene, pose, camera)
    near = near_objects(truth_of(scene, seen, pose, camera))
    return expose(seen.color, Sensor(), np.random.default_rng(seed)), near
