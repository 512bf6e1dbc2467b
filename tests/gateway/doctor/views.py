"""What a colour and a depth camera see of the simulated warehouse, with their faults."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.image import ImageFrame
from services.simulator.world import Camera, Drive, Pose, Scene, Sensor, expose, generate, render
from tests.gateway.doctor.seeing import header

SEED = 710
PLACES = 6
ALIGNED = Camera(320, 240, 232.8, 232.8, 159.5, 119.5)


@cache
def _world(seed: int) -> tuple[Scene, Drive]:
    scene = generate(seed)
    return scene, Drive.plan(scene)


def color(place: int, seed: int = SEED) -> ImageFrame:
    """Return a colour camera's picture from one of the places of a drive."""
    scene, drive = _world(seed)
    seen = render(scene, drive.pose(place / PLACES), ALIGNED).color
    return frame(expose(seen, Sensor(), np.random.default_rng((seed, place))), "rgb8")


def depth(place: int, camera: Camera = ALIGNED, aside: float = 0.0, seed: int = SEED) -> NDArray[np.uint16]:
    """Return what a depth camera so many metres to the right measures from there, in millimetres.

    It does not reach beyond 8 m, is off by half a per cent, and has holes where one thing ends before another.
    """
    scene, drive = _world(seed)
    pose = drive.pose(place / PLACES)
    moved = Pose(pose.position + np.float32(aside) * pose.rotation[:, 0], pose.rotation)
    found = render(scene, moved, camera).depth
    rng = np.random.default_rng((seed, place, 1))
    found = np.where(found < 8, found * rng.normal(1, 0.005, found.shape), 0)
    ends = np.abs(np.diff(found, axis=1, prepend=found[:, :1])) > 0.15
    ends |= np.roll(ends, -1, 1) | np.roll(ends, 1, 1)
    return np.where(ends & (rng.random(found.shape) < 0.6), 0, found * 1000).astype(np.uint16)


def frame(pixels: NDArray[Any], encoding: str, *, is_bigendian: bool = False, padding: int = 0) -> ImageFrame:
    """Return the pixels as an image, with so many bytes behind each row."""
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(pixels.shape[0], -1)
    data = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    return ImageFrame(
        header=header(),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        step=data.shape[1],
        data=data.ravel().data,
        is_bigendian=is_bigendian,
    )
