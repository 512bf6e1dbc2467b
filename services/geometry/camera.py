"""Maps between a camera's pixels and their viewing directions."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from schemas.camera_info import CameraInfo, is_calibrated
from services.geometry.distortion import Distortion, distortion_of
from services.geometry.errors import CalibrationError

Floats = NDArray[np.float32]
Indices = NDArray[np.intp]
Numbers = NDArray[Any]
Points = Numbers | Sequence[Any]
"""An array, or anything that converts to one."""

MAX_PIXELS: Final = 1 << 23
"""Maximum number of pixels of an image whose every pixel gets a direction: 8 bytes each are kept."""

KEPT_PIXELS: Final = 1 << 22
"""Of larger images, the directions of single pixels are calculated each time."""

_AT_ONCE: Final = 1 << 18


@dataclass(frozen=True, eq=False)
class CameraModel:
    """A camera described by its CameraInfo. Immutable; expensive parts are made once.

    height, width: pixels of the pictures it sends. fx, fy, cx, cy, skew: of those pixels, (0, 0) being the centre of
    the upper left one. Points are in the optical frame (x right, y down, z forward), in metres.
    """

    height: int
    width: int
    fx: float
    fy: float
    cx: float
    cy: float
    skew: float
    lens: Distortion

    @classmethod
    def of(cls, info: CameraInfo) -> Self:
        """Return the camera of a CameraInfo's images: cropped to its region, binned.

        Raises:
            CalibrationError: it is not calibrated, or in a way that is unknown.
        """
        if not is_calibrated(info):
            raise CalibrationError("the camera is not calibrated: its camera info has no focal length")
        k = np.asarray(info.k, np.float64).reshape(3, 3)
        across, down = max(info.binning_x, 1), max(info.binning_y, 1)
        return cls(
            height=(info.roi.height or info.height) // down,
            width=(info.roi.width or info.width) // across,
            fx=float(k[0, 0]) / across,
            fy=float(k[1, 1]) / down,
            cx=(float(k[0, 2]) - info.roi.x_offset) / across,
            cy=(float(k[1, 2]) - info.roi.y_offset) / down,
            skew=float(k[0, 1]) / across,
            lens=distortion_of(info.distortion_model, info.d),
        )

    def check_size(self, height: int, width: int) -> None:
        """Raise CalibrationError unless the camera is calibrated for images of this size."""
        if (height, width) != (self.height, self.width):
            raise CalibrationError(f"calibrated for {self.width}x{self.height} pixels, the image has {width}x{height}")

    def project(self, points: Points) -> Numbers:
        """Return the pixels (n, 2; column, row) of points (n, 3); NaN for points not in front of the camera.

        A pixel may lie outside the picture.
        """
        x, y, z = np.asarray(points, np.float64).reshape(-1, 3).T
        return np.stack(self.pixels_of(x, y, z), axis=1)

    def pixels_of(self, x: Numbers, y: Numbers, z: Numbers) -> tuple[Numbers, Numbers]:
        """Return the columns and rows of points, arrays of any one shape and float type; see `project`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            near = np.where(z > 0, z, np.nan)
            x, y = self.lens.distort(x / near, y / near)
        columns = self.fx * x + self.cx
        return columns + self.skew * y if self.skew else columns, self.fy * y + self.cy

    def undistort(self, pixels: Points) -> Numbers:
        """Return the viewing directions (n, 2; x / z, y / z) of pixels (n, 2); NaN where the lens admits none."""
        columns, rows = np.asarray(pixels, np.float64).reshape(-1, 2).T
        y = (rows - self.cy) / self.fy
        return np.stack(self.lens.undistort((columns - self.cx - self.skew * y) / self.fx, y), axis=1)

    def unproject(self, pixels: Points, depth: Points) -> Numbers:
        """Return the points (n, 3) shown by pixels (n, 2) at metres along the optical axis (n)."""
        directions = self.undistort(pixels)
        return np.column_stack([directions, np.ones(len(directions))]) * np.asarray(depth, np.float64)[:, np.newaxis]

    def rays(self) -> Floats:
        """Return the direction of every pixel, x / z and y / z, 2 x height x width; see `undistort`. Read only.

        Raises:
            CalibrationError: there are more than MAX_PIXELS.
        """
        if self.height * self.width > MAX_PIXELS:
            raise CalibrationError(f"{self.width}x{self.height} pixels, at most {MAX_PIXELS} are placed")
        return self._rays

    def rays_of(self, pixels: Indices) -> tuple[Floats, Floats]:
        """Return the directions x / z and y / z of pixels, by their flat places, in arrays of the same shape."""
        if self.height * self.width <= KEPT_PIXELS:
            x, y = (plane.take(pixels) for plane in self._rays.reshape(2, -1))
            return x, y
        x, y = self._directions(pixels.reshape(-1)).reshape(2, *pixels.shape)
        return x, y

    @cached_property
    def _rays(self) -> Floats:
        count = self.height * self.width
        made = np.empty((2, count), np.float32)
        for start in range(0, count, _AT_ONCE):
            some = np.arange(start, min(start + _AT_ONCE, count))
            made[:, some] = self._directions(some)
        return _frozen(made.reshape(2, self.height, self.width))

    def _directions(self, pixels: Indices) -> Floats:
        rows, columns = np.divmod(pixels, self.width)
        return np.ascontiguousarray(self.undistort(np.column_stack([columns, rows])).T, np.float32)


def _frozen(made: Floats) -> Floats:
    made.flags.writeable = False
    return made
