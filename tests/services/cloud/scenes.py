"""Exact views of boxes on a floor: what a depth camera and a lidar measure of them, and which pixels are whose."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Box, Detection, Detections
from services.geometry.camera import CameraModel
from services.geometry.distortion import Straight
from tests.schemas.frames import header
from tests.schemas.masks import coco_mask

HEIGHT, WIDTH, FOCAL = 480, 640, 480.0
CAMERA = CameraModel(
    height=HEIGHT, width=WIDTH, fx=FOCAL, fy=FOCAL, cx=WIDTH / 2 - 0.5, cy=HEIGHT / 2 - 0.5, skew=0.0, lens=Straight()
)
WALL_M = 9.0
CAMERA_HEIGHT_M = 1.5

OPTICAL_IN_BASE = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, CAMERA_HEIGHT_M], [0, 0, 0, 1]])
"""A level camera above the origin of a frame with x ahead, y left and z up."""


@dataclass(frozen=True)
class Cuboid:
    """A box that stands on the floor; centre: x ahead and y left of the camera."""

    centre: tuple[float, float]
    size: tuple[float, float, float]
    yaw: float = 0.0

    def hit(self, origin: NDArray[Any], rays: NDArray[Any]) -> NDArray[Any]:
        """Return how many times each ray (n, 3), in the frame with z up, fits between its origin and the box."""
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
        start = turn @ (origin - [*self.centre, self.size[2] / 2])
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead = rays @ turn.T
            one, other = (-np.divide(self.size, 2) - start) / ahead, (np.divide(self.size, 2) - start) / ahead
        near, far = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
        return np.where((near <= far) & (near > 0), near, np.inf)


def cast(origin: NDArray[Any], rays: NDArray[Any], boxes: tuple[Cuboid, ...]) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Return how far along each ray something is, and what: 0 for floor and wall, boxes counted from 1."""
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = np.where(rays[:, 2] < 0, -origin[2] / rays[:, 2], np.inf)
        wall = np.where(rays[:, 0] > 0, (WALL_M - origin[0]) / rays[:, 0], np.inf)
    ways = np.stack([np.minimum(floor, wall), *(box.hit(origin, rays) for box in boxes)])
    return ways.min(axis=0), ways.argmin(axis=0)


@cache
def camera_view(boxes: tuple[Cuboid, ...], *, noise: float = 0.0) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """Return the points (height, width, 3) in the optical frame, and what each pixel shows."""
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    rays = np.stack([(columns - CAMERA.cx) / FOCAL, (rows - CAMERA.cy) / FOCAL, np.ones(columns.shape)], axis=-1)
    ways, owners = cast(OPTICAL_IN_BASE[:3, 3], rays.reshape(-1, 3) @ OPTICAL_IN_BASE[:3, :3].T, boxes)
    ways = ways + noise * np.random.default_rng(0).standard_normal(ways.shape)
    points = rays * ways.reshape(HEIGHT, WIDTH, 1)
    return points.astype(np.float32), owners.reshape(HEIGHT, WIDTH)


def lidar_view(boxes: tuple[Cuboid, ...], origin: NDArray[Any]) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """Return what a lidar of 64 rings sees, (n, 3) in its own frame, level with x ahead, and what each point is of."""
    up, around = np.meshgrid(np.radians(np.linspace(-35, 10, 64)), np.radians(np.arange(-180, 180, 0.4)))
    rays = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1).reshape(-1, 3)
    ways, owners = cast(origin, rays, boxes)
    points = rays * np.where(np.isinf(ways), np.nan, ways)[:, None]
    return points.astype(np.float32), owners


def detection(pixels: NDArray[np.bool_] | None, name: str = "box", label: int = 2) -> Detection:
    mask = None if pixels is None else coco_mask(pixels)
    return Detection(name=name, score=0.9, box=Box(0, 0, 1, 1), mask=mask, label=label)


def detections(*found: Detection) -> Detections:
    return Detections(header=header(seq=7), height=HEIGHT, width=WIDTH, objects=list(found), model="m", worker="d")
