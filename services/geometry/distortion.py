"""Distortion models of sensor_msgs/distortion_models.h, in both directions.

Points are of the plane at distance 1 before the camera, x / z and y / z, in arrays of any one shape and float type.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from schemas.camera_info import EQUIDISTANT, coefficients_of
from services.geometry.errors import CalibrationError

Plane = NDArray[Any]
Pair = tuple[Plane, Plane]
Slope = tuple[Plane, Plane, Plane, Plane]
"""x over x, x over y, y over x and y over y."""

_STEPS: Final = 50
_CLOSE: Final = 1e-10
_STRAY: Final = 1e-6
_GRID: Final = 4_096
_WIDEST: Final = np.radians(89.0)
_BROWN: Final = 12


class Distortion(Protocol):
    """The distortion of a lens."""

    def distort(self, x: Plane, y: Plane) -> Pair:
        """Return the distorted points; NaN where the distortion is outside the model's range."""

    def undistort(self, x: Plane, y: Plane) -> Pair:
        """Return the undistorted points; NaN where there are none."""


class Straight:
    """A lens without distortion."""

    def distort(self, x: Plane, y: Plane) -> Pair:
        """See `Distortion.distort`."""
        return x, y

    def undistort(self, x: Plane, y: Plane) -> Pair:
        """See `Distortion.undistort`."""
        return x, y


@dataclass(frozen=True)
class Brown:
    """plumb_bob and rational_polynomial: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, in OpenCV's order."""

    d: tuple[float, ...]
    widest: float = field(init=False)
    rising: Pair = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Find the radius up to which the model is valid: where it is still monotonic."""
        radii = np.tan(np.linspace(0, _WIDEST, _GRID))
        object.__setattr__(self, "rising", _rising(radii, radii * self._radial(radii**2)))
        object.__setattr__(self, "widest", float(self.rising[0][-1]))

    def distort(self, x: Plane, y: Plane) -> Pair:
        """See `Distortion.distort`."""
        _, _, p1, p2, _, _, _, _, s1, s2, s3, s4 = self.d
        r2 = x * x + y * y
        factor = self._radial(r2)
        factor[~(r2 <= self.widest**2)] = np.nan
        bent_x = x * factor + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + s2 * r2)
        bent_y = y * factor + 2 * p2 * x * y + p1 * (r2 + 2 * y * y) + r2 * (s3 + s4 * r2)
        return bent_x, bent_y

    def undistort(self, x: Plane, y: Plane) -> Pair:
        """See `Distortion.undistort`. Newton's method, started from radial distortion alone."""
        bent = np.hypot(x, y)
        factor = _ratio(_unbent(bent, self.rising), bent)
        found_x, found_y = x * factor, y * factor
        for _ in range(_STEPS):
            bent_x, bent_y = self.distort(found_x, found_y)
            step_x, step_y = _solve(self._slope(found_x, found_y), bent_x - x, bent_y - y)
            found_x, found_y = found_x - step_x, found_y - step_y
            if np.nanmax(np.hypot(step_x, step_y), initial=0) < _CLOSE:
                break
        bent_x, bent_y = self.distort(found_x, found_y)
        found_x[~(np.hypot(bent_x - x, bent_y - y) < _STRAY)] = np.nan
        return found_x, found_y

    def _radial(self, r2: Plane) -> Plane:
        k1, k2, _, _, k3, k4, k5, k6 = self.d[:8]
        over = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        if not (k4 or k5 or k6):
            return np.asarray(over)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(over / (1 + r2 * (k4 + r2 * (k5 + r2 * k6))))

    def _slope(self, x: Plane, y: Plane) -> Slope:
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = self.d
        r2 = x * x + y * y
        under = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        factor = self._radial(r2)
        with np.errstate(divide="ignore", invalid="ignore"):
            rise = (k1 + r2 * (2 * k2 + r2 * 3 * k3) - factor * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) / under
        mixed = 2 * x * y * rise + 2 * (p1 * x + p2 * y)
        prism_x, prism_y = s1 + 2 * s2 * r2, s3 + 2 * s4 * r2
        return (
            factor + 2 * x * x * rise + 2 * p1 * y + 6 * p2 * x + 2 * x * prism_x,
            mixed + 2 * y * prism_x,
            mixed + 2 * x * prism_y,
            factor + 2 * y * y * rise + 2 * p2 * x + 6 * p1 * y + 2 * y * prism_y,
        )


@dataclass(frozen=True)
class Equidistant:
    """A fisheye lens: k1 to k4 of the angle's polynomial (Kannala and Brandt)."""

    k: tuple[float, ...]
    widest: float = field(init=False)
    rising: Pair = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Find the angle up to which the model is valid: below 90 degrees, where it is still monotonic."""
        angles = np.linspace(0, _WIDEST, _GRID)
        object.__setattr__(self, "rising", _rising(angles, self._bend(angles)))
        object.__setattr__(self, "widest", float(self.rising[0][-1]))

    def distort(self, x: Plane, y: Plane) -> Pair:
        """See `Distortion.distort`."""
        radii = np.hypot(x, y)
        angles = np.arctan(radii)
        angles[angles > self.widest] = np.nan
        factor = _ratio(self._bend(angles), radii)
        return x * factor, y * factor

    def undistort(self, x: Plane, y: Plane) -> Pair:
        """See `Distortion.undistort`. Newton's method."""
        bent = np.hypot(x, y)
        angles = _unbent(bent, self.rising)
        for _ in range(_STEPS):
            miss = self._bend(angles) - bent
            angles = np.clip(angles - miss / self._slope(angles), 0, self.widest)
            if np.nanmax(np.abs(miss), initial=0) < _CLOSE:
                break
        angles[~(np.abs(self._bend(angles) - bent) < _STRAY)] = np.nan
        factor = _ratio(np.tan(angles), bent)
        return x * factor, y * factor

    def _bend(self, angles: Plane) -> Plane:
        k1, k2, k3, k4 = self.k
        square = angles * angles
        return np.asarray(angles * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4)))))

    def _slope(self, angles: Plane) -> Plane:
        k1, k2, k3, k4 = self.k
        square = angles * angles
        slope = 1 + square * (3 * k1 + square * (5 * k2 + square * (7 * k3 + square * 9 * k4)))
        return np.asarray(np.where(np.abs(slope) < _CLOSE, _CLOSE, slope))


def distortion_of(model: str, coefficients: Sequence[float]) -> Distortion:
    """Return the lens that `distortion_model` and `d` of a CameraInfo describe, cached; without `d` a straight one.

    Raises:
        CalibrationError: an unknown model, or not as many coefficients as it has.
    """
    d = coefficients_of(model, [float(number) for number in coefficients])
    if isinstance(d, str):
        raise CalibrationError(d)
    return _lens(model, d)


@lru_cache(maxsize=64)
def _lens(model: str, d: tuple[float, ...]) -> Distortion:
    if model in EQUIDISTANT:
        return Equidistant(d)
    return Brown((*d, *(0.0 for _ in range(_BROWN)))[:_BROWN]) if d else Straight()


def _rising(values: Plane, bent: Plane) -> Pair:
    """Return ascending values up to where their distorted values stop ascending, and these."""
    falls = np.flatnonzero(~(np.diff(bent) > 0))
    end = falls[0] + 1 if len(falls) else len(values)
    return values[:end], bent[:end]


def _unbent(bent: Plane, rising: Pair) -> Plane:
    """Return approximate undistorted values, interpolated: close enough for Newton's method to converge."""
    values, bends = rising
    return np.asarray(np.interp(bent, bends, values))


def _ratio(over: Plane, under: Plane) -> Plane:
    """Return over / under, 1 where both are 0."""
    return np.asarray(np.divide(over, under, out=np.ones_like(over), where=under > 0))


def _solve(slope: Slope, x: Plane, y: Plane) -> Pair:
    """Return the Newton steps in x and y for these residuals and slopes."""
    a, b, c, d = slope
    with np.errstate(divide="ignore", invalid="ignore"):
        whole = a * d - b * c
        return (d * x - b * y) / whole, (a * y - c * x) / whole
