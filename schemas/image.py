"""ImageFrame: one camera image, raw or compressed, with ROS's own pixel encoding names; and areas of images."""

import math
from itertools import pairwise
from typing import Annotated, Final

import msgspec

from schemas.compression import MAX_DECODED_BYTES, RAW, ZSTD, check_zstd, picture_of
from schemas.errors import SchemaError
from schemas.header import Header

BAYER_PATTERNS: Final = ("rggb", "bggr", "gbrg", "grbg")

BYTES_PER_PIXEL: Final = {
    "rgb8": 3,
    "bgr8": 3,
    "rgba8": 4,
    "bgra8": 4,
    "mono8": 1,
    "mono16": 2,
    "yuv422": 2,
    "16UC1": 2,
    "32FC1": 4,
    **{f"bayer_{pattern}8": 1 for pattern in BAYER_PATTERNS},
    **{f"bayer_{pattern}16": 2 for pattern in BAYER_PATTERNS},
}
"""Encodings of sensor_msgs/image_encodings.h that this contract carries. yuv422 is UYVY: two pixels in four bytes."""

DEPTH_ENCODINGS: Final = frozenset({"16UC1", "32FC1"})
"""Distances along the optical axis: millimetres with 0 for no reading, and metres with NaN for none."""

HELD_AS: Final = {
    "mono8": {"mono8", *(f"bayer_{pattern}8" for pattern in BAYER_PATTERNS)},
    "mono16": {"mono16", "16UC1", "32FC1", *(f"bayer_{pattern}16" for pattern in BAYER_PATTERNS)},
    "rgb8": {"rgb8"},
    "rgba8": {"rgba8"},
}
"""Possible encodings of the pixels by what a compressed file declares."""

MAX_SIDE: Final = 16_384
MAX_STEP: Final = MAX_SIDE * 16

Side = Annotated[int, msgspec.Meta(ge=1, le=MAX_SIDE)]


class ImageFrame(msgspec.Struct, frozen=True, kw_only=True):
    """An image of height x width pixels, rows `step` bytes apart, top row first.

    data: height * step bytes; decoded without a copy, so it is a view into the received payload.
    is_bigendian: byte order of pixels whose channels have more than 8 bits.
    format: `raw`; `zstd`: data is one Zstandard frame of what raw data would be; or `jpeg` or `png`: data is such a
        file, decoded its pixels are of `encoding` (a grey file may be a mosaic or depth), and a row of them takes
        `step` bytes.
    inverse_depth: (a, b) where a png's 16-bit values v stand for 32FC1: a / (v - b) metres, and NaN for 0.

    >>> frame = fleetsight.ImageFrame(
    ...     header=header, height=2, width=3, encoding="rgb8", step=9, data=memoryview(bytes(18))
    ... )
    >>> np.frombuffer(frame.data, np.uint8).reshape(frame.height, frame.step)[:, : 3 * frame.width].shape
    (2, 9)
    """

    header: Header
    height: Side
    width: Side
    encoding: Annotated[str, msgspec.Meta(max_length=32)]
    step: Annotated[int, msgspec.Meta(ge=1, le=MAX_STEP)]
    data: memoryview
    is_bigendian: bool = False
    format: Annotated[str, msgspec.Meta(max_length=32)] = RAW
    inverse_depth: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Check the pixel layout.

        Raises:
            SchemaError: encoding or format are unknown, or step or data do not fit the dimensions.
        """
        if self.format not in {RAW, ZSTD}:
            check_picture(self)
            return
        if self.inverse_depth is not None:
            raise SchemaError(f"inverse depth in a {self.format} image")
        size = self.data.nbytes if self.format == RAW else self.step * self.height
        check_layout(self.height, self.width, self.encoding, self.step, size)
        if self.format == ZSTD:
            check_zstd(self.data, size)


def check_layout(height: int, width: int, encoding: str, step: int, size: int) -> None:
    """Check dimensions in pixels, row pitch and data size in bytes against each other, before anything is allocated.

    Raises:
        SchemaError: naming the first thing that does not fit.
    """
    _check_dimensions(height, width)
    if encoding not in BYTES_PER_PIXEL:
        raise SchemaError(f"unknown encoding: {encoding[:32]!r}")
    if encoding == "yuv422" and width % 2:
        raise SchemaError(f"yuv422 pixels come in pairs, and a row has {width}")
    check_rows(height, width, width * BYTES_PER_PIXEL[encoding], step, size, encoding=encoding)


def check_rows(height: int, width: int, row: int, step: int, size: int, *, encoding: str) -> None:
    """Check like `check_layout` for pixels of any encoding, with `row` bytes per row without padding.

    Raises:
        SchemaError: naming the first thing that does not fit.
    """
    _check_dimensions(height, width)
    if step < row:
        raise SchemaError(f"step too short: {step} bytes a row, {width} {encoding} pixels need {row}")
    if step > MAX_STEP:
        raise SchemaError(f"absurd step: {step} bytes a row, at most {MAX_STEP}")
    if size != step * height:
        raise SchemaError(f"data does not fit: {size} bytes, step x height is {step * height}")


def _check_dimensions(height: int, width: int) -> None:
    if not (1 <= height <= MAX_SIDE and 1 <= width <= MAX_SIDE):
        raise SchemaError(f"absurd dimensions: {width}x{height} pixels")


def check_picture(frame: ImageFrame) -> None:
    """Check a compressed frame against its file header, before anything is decoded.

    Raises:
        SchemaError: naming the first thing that does not fit.
    """
    size = frame.step * frame.height
    check_layout(frame.height, frame.width, frame.encoding, frame.step, size)
    if size > MAX_DECODED_BYTES:
        raise SchemaError(f"{size} bytes of pixels, at most {MAX_DECODED_BYTES} are decoded")
    found = picture_of(frame.data)
    if frame.format != found.format:
        raise SchemaError(f"format {frame.format!r}, the file is {found.format}")
    if (frame.height, frame.width) != (found.height, found.width):
        raise SchemaError(f"{frame.width}x{frame.height} pixels, the file has {found.width}x{found.height}")
    if frame.encoding not in HELD_AS[found.encoding]:
        raise SchemaError(f"{frame.encoding} pixels, the file has {found.encoding}")
    if (frame.encoding == "32FC1") != (frame.inverse_depth is not None):
        raise SchemaError(f"{frame.encoding} pixels and inverse depth {frame.inverse_depth}")


Corner = tuple[float, float]
"""Shares of an image's width and height, from its left and top."""

Area = tuple[Corner, ...]
"""A polygon; its last corner is joined to the first."""

LEAST_CORNERS: Final = 3
MOST_CORNERS: Final = 64


def parse_area(text: str) -> Area:
    """Return the polygon for its text in settings, like `0:0 1:0 1:0.2 0:0.2`.

    Raises:
        ValueError: naming what can be written.
    """
    corners = tuple(_corner(word) for word in text.split())
    if not LEAST_CORNERS <= len(corners) <= MOST_CORNERS:
        raise ValueError(
            f"{text!r} is not an area; use {LEAST_CORNERS} to {MOST_CORNERS} corners like 0:0 1:0 1:0.2, each"
            " ACROSS:DOWN as shares of the image's width and height"
        )
    return corners


def _corner(word: str) -> Corner:
    across, _, down = word.partition(":")
    try:
        corner = float(across), float(down)
    except ValueError:
        corner = math.nan, math.nan
    if not all(0 <= share <= 1 for share in corner):
        raise ValueError(f"{word!r} is not a corner; use ACROSS:DOWN, each from 0 to 1, like 0.5:0.2")
    return corner


def is_inside(area: Area, across: float, down: float) -> bool:
    """Return whether a polygon winds around a point, also where its sides cross."""
    windings = 0
    for (begin_x, begin_y), (end_x, end_y) in pairwise((*area, area[0])):
        if (begin_y > down) != (end_y > down) and across < begin_x + (down - begin_y) * (end_x - begin_x) / (
            end_y - begin_y
        ):
            windings += 1 if end_y > begin_y else -1
    return windings != 0
