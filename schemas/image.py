"""ImageFrame: one camera image with ROS's own pixel encoding names."""

from typing import Annotated, Final

import msgspec

from schemas.errors import SchemaError
from schemas.header import Header

BYTES_PER_PIXEL: Final = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1}
"""Encodings of sensor_msgs/image_encodings.h that this contract carries."""

MAX_SIDE: Final = 16_384
MAX_STEP: Final = MAX_SIDE * 16

Side = Annotated[int, msgspec.Meta(ge=1, le=MAX_SIDE)]


class ImageFrame(msgspec.Struct, frozen=True, kw_only=True):
    """An image of height x width pixels, rows `step` bytes apart, top row first.

    data: height * step bytes; decoded without a copy, so it is a view into the received payload.
    """

    header: Header
    height: Side
    width: Side
    encoding: Annotated[str, msgspec.Meta(max_length=32)]
    step: Annotated[int, msgspec.Meta(ge=1, le=MAX_STEP)]
    data: memoryview

    def __post_init__(self) -> None:
        """Hold the pixel layout together.

        Raises:
            SchemaError: the encoding is unknown, or step or data do not fit the dimensions.
        """
        check_layout(self.height, self.width, self.encoding, self.step, self.data.nbytes)


def check_layout(height: int, width: int, encoding: str, step: int, size: int) -> None:
    """Check dimensions in pixels, row pitch and data size in bytes against each other, before anything is allocated.

    Raises:
        SchemaError: naming the first thing that does not fit.
    """
    if not (1 <= height <= MAX_SIDE and 1 <= width <= MAX_SIDE):
        raise SchemaError(f"absurd dimensions: {width}x{height} pixels")
    if encoding not in BYTES_PER_PIXEL:
        raise SchemaError(f"unknown encoding: {encoding[:32]!r}")
    row = width * BYTES_PER_PIXEL[encoding]
    if step < row:
        raise SchemaError(f"step too short: {step} bytes a row, {width} {encoding} pixels need {row}")
    if step > MAX_STEP:
        raise SchemaError(f"absurd step: {step} bytes a row, at most {MAX_STEP}")
    if size != step * height:
        raise SchemaError(f"data does not fit: {size} bytes, step x height is {step * height}")
