"""Registers depth to another camera: each reading becomes a point, drawn into the other image, nearest first."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.geometry.camera import CameraModel
from services.geometry.errors import CalibrationError

Floats = NDArray[np.float32]
Numbers = NDArray[np.float64]

MAX_PIXELS: Final = 1 << 24
"""Maximum number of pixels of the image that depth is registered to."""

MAX_SPLAT: Final = 8
"""Maximum number of pixels of the other image, across and down, that one reading covers."""

AT_ONCE: Final = 1 << 14
"""Approximate number of readings moved at once: intermediate results stay in the processor's caches."""

_SAME_PIXELS: Final = 0.5
_SAME_M: Final = 1e-4
_WHOLE: Final = 0.01


def is_registered(depth: CameraModel, color: CameraModel, color_from_depth: Numbers) -> bool:
    """Return whether depth and colour pixels coincide to within half a pixel, at any distance."""
    if (depth.height, depth.width) != (color.height, color.width):
        return False
    if np.abs(color_from_depth - np.identity(4)).max() > _SAME_M:
        return False
    across, down = (np.linspace(0, side - 1, 3) for side in (depth.width, depth.height))
    some = np.array([(x, y) for x in across for y in down])
    seen = depth.unproject(some, np.ones(len(some)))
    sees = np.isfinite(seen).all(axis=1)
    return bool((np.abs(color.project(seen) - some)[sees] <= _SAME_PIXELS).all())


class Registration:
    """Converts depth images of one camera into the view of a camera at another place.

    color_from_depth: 4 x 4, moves points of depth's optical frame into colour's.

    Raises:
        CalibrationError: a picture of either camera is too large.
    """

    def __init__(self, depth: CameraModel, color: CameraModel, color_from_depth: Numbers) -> None:
        if color.height * color.width > MAX_PIXELS:
            raise CalibrationError(f"{color.width}x{color.height} pixels, depth is registered to {MAX_PIXELS} at most")
        self._depth = depth
        self._color = color
        x, y = depth.rays()
        self._directions = [row[0] * x + row[1] * y + row[2] for row in color_from_depth[:3, :3].astype(np.float32)]
        self._offset = [float(number) for number in color_from_depth[:3, 3]]
        self._splat = _splat(color.fx / depth.fx), _splat(color.fy / depth.fy)

    def apply(self, depth_m: Floats) -> Floats:
        """Return depth along the colour camera's axis at each of its pixels, NaN where no reading falls on it.

        depth_m: height x width, NaN for no reading.

        Raises:
            CalibrationError: the image is not of the depth camera's size.
        """
        self._depth.check_size(*depth_m.shape)
        across, down = self._splat
        drawn = np.full((self._color.height + down - 1, self._color.width + across - 1), np.inf, np.float32)
        at_once = max(1, AT_ONCE // depth_m.shape[1])
        for top in range(0, len(depth_m), at_once):
            self._draw(drawn, depth_m, slice(top, top + at_once))
        made = drawn[down - 1 :, across - 1 :]
        made[np.isinf(made)] = np.nan
        return made

    def _draw(self, drawn: Floats, depth_m: Floats, some: slice) -> None:
        """Draw some rows of depth, also readings just left of or above the image that reach into it."""
        x, y, z = (
            direction[some] * depth_m[some] + offset
            for direction, offset in zip(self._directions, self._offset, strict=True)
        )
        columns, rows = self._color.pixels_of(x, y, z)
        across, down = self._splat
        columns, rows = columns + np.float32(across / 2), rows + np.float32(down / 2)
        with np.errstate(invalid="ignore"):
            inside = (columns >= 0) & (columns < drawn.shape[1]) & (rows >= 0) & (rows < drawn.shape[0])
        columns, rows, z = columns[inside].astype(np.intp), rows[inside].astype(np.intp), z[inside]
        for row in range(down):
            for column in range(across):
                _put(drawn, columns + column, rows + row, z)


def _splat(finer: float) -> int:
    """Return the number of pixels that a reading covers in a finer image, so that near surfaces have no holes."""
    return max(1, min(math.ceil(finer - _WHOLE), MAX_SPLAT))


def _put(made: Floats, columns: NDArray[np.intp], rows: NDArray[np.intp], z: Floats) -> None:
    """Draw each depth at its pixel unless a nearer one is there."""
    inside = (columns < made.shape[1]) & (rows < made.shape[0])
    np.minimum.at(made.reshape(-1), (rows * made.shape[1] + columns)[inside], z[inside])
