"""Pictures of simulated warehouses, 640x480."""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.simulator.world import Camera, Drive, Sensor, expose, generate, render

SCENES: Final = range(3_000_000, 3_000_004)
FRACTIONS: Final = (0.0, 0.3, 0.6)


def views() -> list[NDArray[np.uint8]]:
    """Return the same dozen pictures every time, in BGR."""
    made = []
    for seed in SCENES:
        scene = generate(seed)
        drive = Drive.plan(scene)
        for fraction in FRACTIONS:
            seen = render(scene, drive.pose(fraction), Camera())
            rgb = expose(seen.color, Sensor(), np.random.default_rng(seed))
            made.append(np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), np.uint8))
    return made
