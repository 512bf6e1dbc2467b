"""Simulates a real stereo depth camera on exact depth: limits, shadows, holes, noise and quantisation.

Its faults live where a stereo camera has them: in disparity (pixels), which is baseline * focal length / depth. So the
noise of depth grows with its square: depth ** 2 * subpixel / (baseline * focal length). Defaults are those of an Intel
RealSense D435: baseline 50 mm, 0.28 m to at most 10 m and depth in millimetres (data sheet of the D400 series), 0.08
pixels of error on well textured scenes (Intel, "Tuning depth cameras for best performance"), disparity in steps of 1/32
pixel. With 640x480 pixels that is 0.7 % of depth at 2 m, where the data sheet allows 2 %.
"""

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, Final

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from services.simulator.world.camera import Camera
from services.simulator.world.cuboids import Floats
from services.simulator.world.sensor import PLANE, window
from services.simulator.world.visibility import NEAR

SPECKLE: Final = 1.0
BORDER: Final = 8
MILLIMETRES: Final = 1000


@dataclass(frozen=True, slots=True)
class DepthSensor:
    """One depth camera's character. Lengths in metres, disparities in pixels, angles from the surface's normal.

    subpixel: standard deviation of the disparity. steps: how finely a pixel of disparity is resolved.
    edge: what disparity may differ between neighbours before an edge spoils them; of such pixels `lost` is the share
    without depth, the others read something between both sides. fading: from which angle on pixels get lost, and at
    which all are.
    """

    least: float = 0.28
    greatest: float = 10.0
    baseline: float = 0.05
    subpixel: float = 0.08
    steps: int = 32
    edge: float = 1.0
    lost: float = 0.6
    fading: tuple[float, float] = (1.36, 1.54)


def sense(depth: Floats, camera: Camera, sensor: DepthSensor, rng: Generator) -> Floats:
    """Measure exact `depth` (height, width) with `sensor`: metres in whole millimetres; 0 is none in both."""
    scale = np.float32(sensor.baseline * camera.fx)
    inverse = np.divide(1, np.maximum(depth, NEAR), out=np.zeros_like(depth), where=depth > 0)
    height, width = depth.shape
    noise, chance = window(_noise(), height, width, rng), window(_chances(), height, width, rng)
    blind = chance < _faded(inverse, camera, sensor)
    disparity: Any = inverse * scale
    blind |= _shadowed(disparity)
    disparity, lost = _at_edges(disparity, chance, sensor)
    blind |= lost
    disparity += noise * np.float32(sensor.subpixel)
    disparity = np.rint(disparity * np.float32(sensor.steps))
    blind |= disparity < scale * sensor.steps / sensor.greatest
    blind |= disparity > scale * sensor.steps / sensor.least
    disparity[blind] = np.inf
    millimetres = np.rint(np.float32(scale * sensor.steps * MILLIMETRES) / disparity)
    return np.asarray(millimetres / np.float32(MILLIMETRES), np.float32)


def as_16uc1(depth: Floats) -> NDArray[np.uint16]:
    """Depth as ROS's `16UC1`: millimetres, 0 for none. Depth beyond 65.535 m is none."""
    millimetres = np.rint(depth * np.float32(MILLIMETRES))
    return np.where(millimetres <= np.iinfo(np.uint16).max, millimetres, 0).astype(np.uint16)


def as_32fc1(depth: Floats) -> Floats:
    """Depth as ROS's `32FC1`: metres, NaN for none."""
    return np.where(depth > 0, depth, np.float32(np.nan))


def _shadowed(disparity: Floats) -> NDArray[np.bool_]:
    """Mask what the right imager cannot see: something more to the right occludes it."""
    columns = np.arange(disparity.shape[1], dtype=np.float32)
    there = columns - disparity
    least = np.minimum.accumulate(there[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(disparity.shape, np.bool_)
    np.less(least[:, 1:], there[:, :-1], out=hidden[:, :-1])
    return hidden


def _at_edges(disparity: Floats, chance: Floats, sensor: DepthSensor) -> tuple[Floats, NDArray[np.bool_]]:
    """The disparity with pixels that mix both sides of an edge, and which pixels are lost there."""
    around = np.ones((3, 3), np.uint8)
    low, high = cv2.erode(disparity, around), cv2.dilate(disparity, around)
    edge = high - low > sensor.edge
    lost = edge & (chance < sensor.lost)
    part = (chance[edge] - np.float32(sensor.lost)) / np.float32(1 - sensor.lost)
    mixed = disparity.copy()
    mixed[edge] = low[edge] + np.clip(part, 0, 1) * (high[edge] - low[edge])
    return mixed, lost


def _faded(inverse: Floats, camera: Camera, sensor: DepthSensor) -> Floats:
    """The probability of losing each pixel at the angle of its surface, 0 to 1."""
    rows, columns = (np.arange(size, dtype=np.float32) for size in inverse.shape)
    x, y = (columns - camera.cx) / camera.fx, ((rows - camera.cy) / camera.fy)[:, None]
    across, down = _slope(inverse, 1) * np.float32(camera.fx), _slope(inverse, 0) * np.float32(camera.fy)
    forward = inverse - across * x - down * y
    steepness = (across**2 + down**2 + forward**2) * (x * x + y * y + 1)
    cosine = inverse / np.sqrt(np.maximum(steepness, np.finfo(np.float32).tiny))
    begin, end = np.cos(np.asarray(sensor.fading, np.float32))
    return np.asarray(np.clip((begin - cosine) / (begin - end), 0, 1), np.float32)


def _slope(values: Floats, axis: int) -> Floats:
    """The gradient from pixel to pixel: the smaller one of both sides, so that edges do not count as slopes."""
    if values.shape[axis] < 2:
        return np.zeros_like(values)
    change = np.diff(values, axis=axis)
    first, last = change.take([0], axis), change.take([-1], axis)
    before, after = np.concatenate([first, change], axis), np.concatenate([change, last], axis)
    return np.where(np.abs(before) < np.abs(after), before, after)


@cache
def _noise() -> Floats:
    """Noise of unit variance, as coherent as window matching makes it; made once."""
    rng = np.random.default_rng(11)
    rough = np.pad(rng.normal(0, 1, (PLANE, PLANE)).astype(np.float32), BORDER, mode="wrap")
    smooth = cv2.GaussianBlur(rough, (0, 0), SPECKLE)[BORDER:-BORDER, BORDER:-BORDER]
    return np.asarray(smooth / smooth.std(), np.float32)


@cache
def _chances() -> Floats:
    """Evenly distributed from 0 to 1, in small patches; made once."""
    rough = np.roll(_noise(), (PLANE // 3, PLANE // 5), (0, 1))
    ranks = np.empty(rough.size, np.float32)
    ranks[np.argsort(rough, axis=None)] = np.arange(rough.size, dtype=np.float32)
    return np.asarray(ranks.reshape(rough.shape) / rough.size, np.float32)


def organised_cloud(depth: Floats, camera: Camera) -> Floats:
    """Points (height, width, 3) in metres of the optical frame, NaN where `depth` (0 or NaN) has none.

    The colour of each point is that of its pixel in the colour image that the depth is registered to.
    """
    cloud = _rays(camera) * depth[..., None]
    cloud[~(depth > 0)] = np.nan
    return np.asarray(cloud, np.float32)


@lru_cache(maxsize=8)
def _rays(camera: Camera) -> Floats:
    x, y = (np.arange(camera.width) - camera.cx) / camera.fx, (np.arange(camera.height) - camera.cy) / camera.fy
    return np.stack([*np.meshgrid(x, y), np.ones((camera.height, camera.width))], axis=-1).astype(np.float32)
