"""Simulates a real colour camera: exposure, white balance, vignetting, blur and noise."""

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, Final, Self, TypeVar

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

PLANE: Final = 1024
Value = TypeVar("Value", bound=np.generic)


def window(plane: NDArray[Value], height: int, width: int, rng: Generator) -> NDArray[Value]:
    """A copy of a random window of `plane` (PLANE, PLANE, ...), which goes on beyond its borders as it began."""
    top, left = int(rng.integers(0, PLANE)), int(rng.integers(0, PLANE))
    rows = np.take(plane, np.arange(top, top + height), axis=0, mode="wrap")
    return np.take(rows, np.arange(left, left + width), axis=1, mode="wrap")


Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Sensor:
    """One camera's character; `blur` is the standard deviation in pixels, `noise` in grey levels of 255."""

    mean_level: float = 118.0
    gamma: float = 1.0
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    vignette: float = 0.1
    blur: float = 0.55
    motion: int = 1
    motion_rad: float = 0.0
    noise: float = 2.5

    @classmethod
    def draw(cls, rng: Generator) -> Self:
        """A camera at random, from good to poor."""
        red, green, blue = rng.normal(1, 0.04, 3)
        return cls(
            mean_level=float(rng.uniform(85, 160)),
            gamma=float(rng.uniform(0.8, 1.25)),
            white_balance=(float(red), float(green), float(blue)),
            vignette=float(rng.uniform(0, 0.3)),
            blur=float(rng.uniform(0.35, 0.9)),
            motion=int(rng.choice([1, 1, 1, 3, 5, 7])),
            motion_rad=float(rng.normal(0, 0.3)),
            noise=float(rng.uniform(0.5, 8)),
        )


def expose(color: Image, sensor: Sensor, rng: Generator) -> Image:
    """Apply `sensor` to a rendered RGB image; returns a new array of the same shape."""
    image: Any = cv2.GaussianBlur(color, (3, 3) if sensor.blur < 0.7 else (5, 5), sensor.blur)
    if sensor.motion > 1:
        image = cv2.filter2D(image, -1, _streak(sensor.motion, sensor.motion_rad))
    image = cv2.LUT(image, _tone(image, sensor))
    height, width = image.shape[:2]
    if sensor.vignette > 0:
        image = cv2.multiply(image, _vignette(height, width, round(sensor.vignette, 2)), scale=1 / 255)
    return _with_noise(image, sensor.noise, rng)


def _tone(image: Image, sensor: Sensor) -> Image:
    """A look-up table (1, 256, 3): automatic exposure to the mean level, white balance, gamma, soft shoulder."""
    mean = max(float(image[::4, ::4].mean()), 4.0)
    levels = np.arange(256, dtype=np.float32)[:, None] / 255 * (sensor.mean_level / mean)
    levels = np.clip(levels * np.asarray(sensor.white_balance, np.float32), 0, None) ** np.float32(sensor.gamma)
    shoulder = np.where(levels > 0.75, 0.75 + 0.25 * np.tanh((levels - 0.75) / 0.25), levels)
    return np.asarray(shoulder * 255 + 0.5, np.uint8)[None]


def _streak(length: int, angle: float) -> NDArray[np.float32]:
    kernel = np.zeros((length, length), np.float32)
    middle, reach = length // 2, length / 2
    step = (int(np.rint(reach * np.cos(angle))), int(np.rint(reach * np.sin(angle))))
    cv2.line(kernel, (middle - step[0], middle - step[1]), (middle + step[0], middle + step[1]), 1.0)
    return np.asarray(kernel / kernel.sum(), np.float32)


@lru_cache(maxsize=32)
def _vignette(height: int, width: int, strength: float) -> Image:
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    plane = 255 * (1 - strength * (x * x + y * y) / 2)
    return np.repeat(plane.astype(np.uint8)[..., None], 3, axis=2)


@cache
def _noise_plane() -> NDArray[np.int8]:
    """Noise of standard deviation 24, made once."""
    rng = np.random.default_rng(7)
    return np.clip(rng.normal(0, 24, (PLANE, PLANE, 3)), -127, 127).astype(np.int8)


def _with_noise(image: Image, sigma: float, rng: Generator) -> Image:
    height, width = image.shape[:2]
    plane = window(_noise_plane(), height, width, rng)
    noisy = cv2.addWeighted(image, 1.0, plane, sigma / 24, 0.0, dtype=cv2.CV_8U)
    return np.asarray(noisy, np.uint8)
