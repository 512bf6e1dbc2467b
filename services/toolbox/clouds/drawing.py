"""Prepares ObjectClouds for drawing: points in colour, and a box of lines around each object. Pure."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.objects import ObjectClouds, UprightBox
from services.geometry.boxes import axes_of
from services.toolbox.clouds.files import points_of

CORNERS: Final = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
EDGES: Final = np.array(
    [[a, b] for a in range(8) for b in range(a + 1, 8) if (CORNERS[a] != CORNERS[b]).sum() == 1], np.int32
)


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """xyz: points, (n, 3) in metres. rgb: (n, 3), 0 to 1. corners: of all boxes, (8 m, 3). edges: pairs of corners.

    up: what is up there, as the boxes have it.
    """

    xyz: NDArray[np.float64]
    rgb: NDArray[np.float64]
    corners: NDArray[np.float64]
    edges: NDArray[np.int32]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)


def drawing_of(seen: ObjectClouds) -> Drawing:
    """Return the shapes to draw, in the sensor's frame."""
    points = points_of(seen)
    boxes = [corners_of(each.shape.box) for each in seen.objects]
    return Drawing(
        points["xyz"].astype(np.float64),
        points["rgb"] / 255,
        np.concatenate(boxes) if boxes else np.zeros((0, 3)),
        np.concatenate([EDGES + 8 * number for number in range(len(boxes))]) if boxes else np.zeros((0, 2), np.int32),
        seen.objects[0].shape.box.up if boxes else (0.0, 0.0, 1.0),
    )


def corners_of(box: UprightBox) -> NDArray[np.float64]:
    """Return the corners of a box, (8, 3)."""
    return np.asarray(box.centre + (CORNERS * box.size) @ axes_of(box))
