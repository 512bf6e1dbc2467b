"""A robot's drive as a loop of pictures, each rendered when it is first needed."""

import numpy as np
from numpy.typing import NDArray

from services.simulator.world import Camera, Drive, Sensor, expose, generate, render


class Film:
    """`frames` pictures along a closed drive through the warehouse of `seed`: the same ones for the same arguments."""

    def __init__(self, seed: int, camera: Camera, frames: int) -> None:
        self._seed = seed
        self._camera = camera
        self._scene = generate(seed)
        self._drive = Drive.plan(self._scene)
        self._pictures: list[NDArray[np.uint8] | None] = [None] * frames

    def picture(self, number: int) -> NDArray[np.uint8]:
        """Return a picture of height x width x 3 in RGB; it starts over after the last."""
        index = number % len(self._pictures)
        picture = self._pictures[index]
        if picture is None:
            seen = render(self._scene, self._drive.pose(index / len(self._pictures)), self._camera)
            picture = expose(seen.color, Sensor(), np.random.default_rng((self._seed, index)))
            self._pictures[index] = picture
        return picture
