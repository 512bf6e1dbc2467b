"""The floor's texture: paint, wear, light pools and the contact shadows of objects."""

from dataclasses import dataclass, replace
from typing import Final, Self

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from services.simulator.world.cuboids import Cuboids, Floats
from services.simulator.world.surfaces import Lighting

TEXELS_PER_METRE: Final = 40
WHITE: Final = 160.0
SHADOWING_HEIGHT: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """`image` (rows, columns, 3) is the lit floor seen from above, `WHITE` standing for 1.0; x runs along columns.

    `bare` is the same before anything stands on it, 1.0 for white. `darkness` and `blur` (pixels) are of the shadows.
    """

    image: NDArray[np.uint8]
    half_x: float
    half_y: float
    bare: Floats
    darkness: float
    blur: float

    def under(self, cuboids: Cuboids) -> Self:
        """The same floor with these things on it."""
        return replace(self, image=_shaded(self.bare, cuboids, self.darkness, self.blur))


def paint_floor(rng: Generator, cuboids: Cuboids, lighting: Lighting, half_x: float, half_y: float) -> Floor:
    """Paint the floor of a hall with the given half extents in metres."""
    columns, rows = int(2 * half_x * TEXELS_PER_METRE), int(2 * half_y * TEXELS_PER_METRE)
    base = rng.uniform(0.3, 0.7) * (1 + rng.normal(0, 0.025, 3))
    image = np.tile(base.astype(np.float32), (rows, columns, 1))
    image *= _stains(rng, rows, columns)[..., None]
    _lines(rng, image)
    image *= _light(lighting, rows, columns, half_x, half_y)[..., None]
    darkness, blur = float(rng.uniform(0.35, 0.65)), float(rng.uniform(3, 8))
    return Floor(_shaded(image, cuboids, darkness, blur), half_x, half_y, image, darkness, blur)


def _shaded(bare: Floats, cuboids: Cuboids, darkness: float, blur: float) -> NDArray[np.uint8]:
    image = bare * (1 - darkness * _shadows(cuboids, blur, *bare.shape[:2]))[..., None]
    return np.clip(image * WHITE, 0, 255).astype(np.uint8)


def _stains(rng: Generator, rows: int, columns: int) -> Floats:
    total = np.ones((rows, columns), np.float32)
    for cells, weight in ((6, 0.05), (25, 0.04), (90, 0.03)):
        coarse = rng.normal(0, weight, (cells, cells)).astype(np.float32)
        total += cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_LINEAR)
    for _ in range(int(rng.integers(2, 10))):  # tyre marks
        start = rng.uniform(0, (columns, rows))
        bend = np.cumsum(rng.normal(0, 0.25, 12)) + rng.uniform(0, 2 * np.pi)
        path = start + np.cumsum(np.stack([np.cos(bend), np.sin(bend)], 1) * 30, axis=0)
        cv2.polylines(total, [path.astype(np.int32)], isClosed=False, color=0.84, thickness=5, lineType=cv2.LINE_AA)
    joint = int(rng.integers(120, 240))
    total[::joint] *= 0.75
    total[:, ::joint] *= 0.75
    return total


def _lines(rng: Generator, image: Floats) -> None:
    rows, columns = image.shape[:2]
    colours = ((0.9, 0.74, 0.12), (0.88, 0.88, 0.86), (0.8, 0.25, 0.15), (0.2, 0.4, 0.75))
    colour = colours[int(rng.choice(4, p=[0.5, 0.3, 0.1, 0.1]))]
    width = int(rng.integers(3, 6))
    inset = int(rng.uniform(1.5, 3.0) * TEXELS_PER_METRE)
    cv2.rectangle(image, (inset, inset), (columns - inset, rows - inset), colour, width, cv2.LINE_AA)
    for _ in range(int(rng.integers(1, 6))):
        x, y = int(rng.integers(inset, columns - inset)), int(rng.integers(inset, rows - inset))
        side_x, side_y = (int(side) for side in rng.uniform(1.0, 2.2, 2) * TEXELS_PER_METRE)
        cv2.rectangle(image, (x, y), (x + side_x, y + side_y), colour, width, cv2.LINE_AA)


def _light(lighting: Lighting, rows: int, columns: int, half_x: float, half_y: float) -> Floats:
    x, y = np.meshgrid(np.linspace(-half_x, half_x, 64), np.linspace(-half_y, half_y, 64))
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).astype(np.float32)
    light = lighting.on(points, np.broadcast_to(np.array([0, 0, 1], np.float32), points.shape))
    return np.asarray(cv2.resize(light, (columns, rows), interpolation=cv2.INTER_LINEAR), np.float32)


def _shadows(cuboids: Cuboids, blur: float, rows: int, columns: int) -> Floats:
    mask = np.zeros((rows, columns), np.float32)
    corners = cuboids.corners()
    lowest, extent = corners[..., 2].min(axis=1), cuboids.half_extents[:, :2].max(axis=1)
    for index in np.flatnonzero((lowest < SHADOWING_HEIGHT) & (lowest > -0.01) & (extent < 4)):
        outline = corners[index, :, :2] * TEXELS_PER_METRE + (columns / 2, rows / 2)
        cv2.fillConvexPoly(mask, cv2.convexHull(outline.astype(np.int32)), 1.0)
    return np.asarray(cv2.GaussianBlur(mask, (0, 0), blur), np.float32)
