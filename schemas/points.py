"""PointCloud: points in space, in their sensor's own layout."""

from collections.abc import Iterable
from typing import Annotated, Final

import msgspec

from schemas.compression import RAW, ZSTD, check_zstd
from schemas.errors import SchemaError
from schemas.header import Header

MAX_FIELDS: Final = 64
MAX_FIELD_NAME: Final = 64

VALUE_BYTES: Final = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 8: 8}
"""Bytes of one value by its type in sensor_msgs/PointField.

1 to 8 are int8, uint8, int16, uint16, int32, uint32, float32 and float64.
"""

UINT8: Final = 2

Uint32 = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]


class PointField(msgspec.Struct, frozen=True):
    """The place of a value in a point: `count` values of `datatype` (see VALUE_BYTES) from `offset` bytes on."""

    name: Annotated[str, msgspec.Meta(max_length=MAX_FIELD_NAME)]
    offset: Uint32
    datatype: Annotated[int, msgspec.Meta(ge=1, le=8)]
    count: Annotated[int, msgspec.Meta(ge=1, le=2**32 - 1)] = 1


class PointCloud(msgspec.Struct, frozen=True, kw_only=True):
    """height rows of width points; an unordered cloud has one row. Coordinates are metres in the header's frame.

    Points are point_step bytes apart, rows row_step. is_dense: no point has a NaN.
    data: height * row_step bytes; decoded without a copy, so it is a view into the received payload.
    format: `raw`, or `zstd`: then data is one Zstandard frame of those bytes.
    """

    header: Header
    height: Uint32
    width: Uint32
    fields: Annotated[list[PointField], msgspec.Meta(max_length=MAX_FIELDS)]
    is_bigendian: bool
    point_step: Uint32
    row_step: Uint32
    data: memoryview
    is_dense: bool
    format: Annotated[str, msgspec.Meta(max_length=32)] = RAW

    def __post_init__(self) -> None:
        """Check the layout.

        Raises:
            SchemaError: the format is unknown, or fields, steps or data do not fit each other.
        """
        if self.format not in {RAW, ZSTD}:
            raise SchemaError(f"unknown format: {self.format!r}")
        size = self.data.nbytes if self.format == RAW else self.row_step * self.height
        check_points(self.height, self.width, self.point_step, self.row_step, size)
        if self.format == ZSTD:
            check_zstd(self.data, size)
        check_fields(self.fields, self.point_step)


def check_points(height: int, width: int, point_step: int, row_step: int, size: int) -> None:
    """Check the number of points against pitches and data size in bytes, before anything is allocated.

    Raises:
        SchemaError: naming the first thing that does not fit.
    """
    if width and point_step < 1:
        raise SchemaError(f"absurd point step: {point_step} bytes")
    if row_step < width * point_step:
        raise SchemaError(
            f"row step too short: {row_step} bytes, {width} points of {point_step} bytes need {width * point_step}"
        )
    if size != row_step * height:
        raise SchemaError(f"data does not fit: {size} bytes, row step x height is {row_step * height}")
    if height > 1 and not width:
        raise SchemaError(f"{height} rows without points")


def check_fields(fields: Iterable[PointField], point_step: int) -> None:
    """Check that every field lies within a point.

    Raises:
        SchemaError: naming the first that does not.
    """
    for field in fields:
        end = field.offset + field.count * VALUE_BYTES[field.datatype]
        if end > point_step:
            raise SchemaError(f"field {field.name!r} ends at byte {end} of a point of {point_step}")


def rgb_offsets(fields: Iterable[PointField], *, is_bigendian: bool) -> tuple[int, int, int] | None:
    """Return the offsets of a point's red, green and blue bytes, or None if it has no colour.

    They are a field each (`r`, `g`, `b`), or one of four bytes, `rgb` or `rgba`, packed as PCL does: 0xAARRGGBB, often
    called a float32.
    """
    known = {field.name: field for field in reversed(list(fields))}
    packed = next((known[name] for name in ("rgb", "rgba") if name in known), None)
    if packed is not None and VALUE_BYTES[packed.datatype] == 4:
        red, green, blue = (1, 2, 3) if is_bigendian else (2, 1, 0)
        return packed.offset + red, packed.offset + green, packed.offset + blue
    if all(name in known and known[name].datatype == UINT8 for name in "rgb"):
        return known["r"].offset, known["g"].offset, known["b"].offset
    return None
