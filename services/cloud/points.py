"""Reads coordinates and colours of a PointCloud of any layout, copying only the requested ones. Pure."""

from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from schemas.compression import ZSTD
from schemas.points import PointCloud, rgb_offsets
from services.geometry.decompression import decompressed
from services.geometry.errors import GeometryError


class CloudError(GeometryError):
    """Unusable points, or an object without any; the text is a reason that fits a result's `unmeasured`."""


Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Indices = NDArray[np.intp]

MAX_POINTS: Final = 4_000_000
"""Maximum number of points of a cloud; a message could hold more, of one byte each."""

FAR_M: Final = 10_000.0
"""Points farther away than this are no readings of a camera or lidar."""

AXES: Final = ("x", "y", "z")
_TYPES: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """A view of a cloud's points: `records` is (height, width), each the bytes of one point.

    axes: what is where in a record. channels: offsets of red, green and blue in it, None where there is no colour.
    """

    records: NDArray[np.void]
    axes: np.dtype[np.void]
    channels: tuple[int, int, int] | None

    @classmethod
    def of(cls, cloud: PointCloud) -> Self:
        """Read the layout of a cloud; its data is copied only to decompress it.

        Raises:
            GeometryError: no x, y or z, too many points, or damaged data.
        """
        if cloud.height * cloud.width > MAX_POINTS:
            raise CloudError(f"a cloud of {cloud.height * cloud.width} points, at most {MAX_POINTS} are looked at")
        fields = {field.name: field for field in reversed(cloud.fields)}
        if missing := [axis for axis in AXES if axis not in fields]:
            raise CloudError(f"a cloud without {', '.join(missing)}")
        order = ">" if cloud.is_bigendian else "<"
        axes = np.dtype(
            {
                "names": AXES,
                "formats": [order + _TYPES[fields[axis].datatype] for axis in AXES],
                "offsets": [fields[axis].offset for axis in AXES],
                "itemsize": cloud.point_step,
            }
        )
        return cls(_records(cloud), axes, rgb_offsets(cloud.fields, is_bigendian=cloud.is_bigendian))

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width; an unordered cloud has one row."""
        height, width = self.records.shape
        return height, width

    @property
    def is_organised(self) -> bool:
        """Whether the points lie in rows and columns like the pixels of an image."""
        return min(self.shape) > 1

    def take(self, at: Indices) -> "Points":
        """Return one row of the points with these indices, counted row by row. Copies them."""
        if self.records.strides[0] == self.records.shape[1] * self.records.itemsize:
            taken = self.records.reshape(-1).take(at)
        else:
            taken = self.records[np.divmod(at, self.shape[1])]
        return Points(taken[None], self.axes, self.channels)

    def xyz(self) -> Floats:
        """Return the coordinates of all points, (3, height * width): metres, NaN and infinities included."""
        coordinates = self.records.view(self.axes)
        xyz = np.empty((3, *self.records.shape), np.float32)
        with np.errstate(over="ignore", invalid="ignore"):
            for number, axis in enumerate(AXES):
                xyz[number] = coordinates[axis]
        return xyz.reshape(3, -1)

    def rgb(self) -> Bytes | None:
        """Return the colours of all points, (height * width, 3), or None where there are none."""
        if self.channels is None:
            return None
        octets = self.records.view([("octets", np.uint8, (self.records.itemsize,))])["octets"]
        return np.stack([octets[..., at] for at in self.channels], axis=-1).reshape(-1, 3)


def usable(xyz: Floats) -> NDArray[np.bool_]:
    """Return which points are readings: within FAR_M, and not the origin, which some drivers send for none."""
    x, y, z = xyz
    with np.errstate(over="ignore", invalid="ignore"):
        apart = x * x + y * y + z * z  # infinite or NaN if any of them is
    return np.asarray((apart > 0) & (apart < FAR_M**2))


def _records(cloud: PointCloud) -> NDArray[np.void]:
    data: Any = decompressed(cloud.data, cloud.row_step * cloud.height) if cloud.format == ZSTD else cloud.data
    shape = (cloud.height, cloud.width)
    if not cloud.height * cloud.width:
        return np.zeros(shape, f"V{cloud.point_step}")
    return np.ndarray(shape, f"V{cloud.point_step}", data, strides=(cloud.row_step, cloud.point_step))


_JITTER: Final = np.random.default_rng(0).random(2048)
_JITTERED: Final = np.arange(len(_JITTER)) + _JITTER


def some(count: int, wanted: int) -> Indices:
    """Return ascending numbers below `count`: all of them or about `wanted`, never more.

    They are spread evenly but not regularly: of rows of points a regular step may take a single column.
    """
    if count <= wanted:
        return np.arange(count)
    taken = (_jittered(wanted) * (count / wanted)).astype(np.intp)
    new = np.empty(wanted, np.bool_)
    new[0] = True
    np.not_equal(taken[1:], taken[:-1], out=new[1:])
    return taken[new]


def spread(counts: Indices, wanted: int) -> Indices:
    """Return exactly `wanted` ascending numbers of each of n consecutive ranges from 0 on: (n, wanted).

    counts: (n,) how long they are. The numbers are spread as `some` does it, and some of them are there twice.
    """
    each = counts[:, np.newaxis]
    return np.asarray(each.cumsum(axis=0) - each + (_jittered(wanted) * (each / wanted)).astype(np.intp))


def _jittered(wanted: int) -> NDArray[np.float64]:
    return _JITTERED[:wanted] if wanted <= len(_JITTER) else np.asarray(np.arange(wanted) + np.resize(_JITTER, wanted))
