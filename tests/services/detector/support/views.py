"""Pictures of warehouses that the shipped model was not trained on, each with something near in it."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.simulator.world import Camera, Drive, Sensor, expose, generate, render


@dataclass(frozen=True, slots=True)
class View:
    """A place on the drive through a scene, and the classes of the objects that fill much of the picture there."""

    seed: int
    fraction: float
    classes: frozenset[str]


NEAR_VIEWS: Final = (
    View(3_000_006, 9 / 12, frozenset({"pallet"})),
    View(3_000_000, 8 / 12, frozenset({"forklift"})),
    View(3_000_002, 0 / 12, frozenset({"box"})),
)


def near_view(view: View = NEAR_VIEWS[0]) -> NDArray[np.uint8]:
    """Return the camera's picture, 480 x 640 x 3, in BGR."""
    scene = generate(view.seed)
    seen = render(scene, Drive.plan(scene).pose(view.fraction), Camera())
    rgb = expose(seen.color, Sensor(), np.random.default_rng(view.seed))
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), np.uint8)
