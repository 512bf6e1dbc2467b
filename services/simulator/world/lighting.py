"""The light on a surface: daylight from above, a main direction, and lamps under the roof."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.random import Generator

from services.simulator.world.cuboids import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Lighting:
    """Lights of one hall. `direction` points to the strongest light; lamps are points in the map frame."""

    ambient: float
    direction: Floats
    strength: float
    lamps: Floats
    lamp_strengths: Floats

    @classmethod
    def draw(cls, rng: Generator, half_x: float, half_y: float) -> Self:
        """A random lighting for a hall of the given half extents."""
        direction = rng.normal(0, 1, 3)
        direction[2] = abs(direction[2]) + 0.5
        count = int(rng.integers(2, 6))
        spread = np.array([half_x, half_y, 1.0]) * 0.8
        lamps = rng.uniform(-1, 1, (count, 3)) * spread + [0, 0, 4.8]
        return cls(
            ambient=float(rng.uniform(0.3, 0.6)),
            direction=(direction / np.linalg.norm(direction)).astype(np.float32),
            strength=float(rng.uniform(0.05, 0.45)),
            lamps=lamps.astype(np.float32),
            lamp_strengths=rng.uniform(0.1, 0.7, count).astype(np.float32),
        )

    def on(self, points: Floats, normals: Floats) -> Floats:
        """Light on `points` (..., 3) of surfaces with unit `normals` (..., 3): about 1 is well lit."""
        light = self.ambient * (0.72 + 0.28 * normals[..., 2])
        light = light + self.strength * np.maximum(normals @ self.direction, 0)
        for lamp, strength in zip(self.lamps, self.lamp_strengths, strict=True):
            towards = lamp - points
            squared = np.sum(towards * towards, axis=-1)
            facing = np.maximum(np.sum(towards * normals, axis=-1), 0) / np.sqrt(squared)
            light = light + strength * facing / (1 + 0.05 * squared)
        return np.asarray(light, np.float32)
