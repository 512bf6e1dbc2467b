"""sensor_msgs/Image to ImageFrame."""

from typing import Final

import msgspec

from gateway.ros1.image import decode_image
from gateway.ros1.subscriber import Message
from gateway.translators.encodings import carried
from gateway.translators.stream_kind import stamped
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.image import DEPTH_ENCODINGS, ImageFrame


def image(message: Message, header: Header) -> ImageFrame:
    """Translate an image of any encoding."""
    found = carried(decode_image(message.data))
    return ImageFrame(
        header=stamped(header, found.stamp, found.frame_id),
        height=found.height,
        width=found.width,
        encoding=found.encoding,
        step=found.step,
        data=found.data,
        is_bigendian=found.is_bigendian,
    )


NOT_COLOR: Final = "pixels are depth, not colour"


def color(message: Message, header: Header) -> ImageFrame:
    """Translate an image that is no depth."""
    return checked_color(image(message, header))


def checked_color(frame: ImageFrame) -> ImageFrame:
    """Return the frame.

    Raises:
        SchemaError: its encoding is one of depth.

    """
    if frame.encoding in DEPTH_ENCODINGS:
        raise SchemaError(f"{frame.encoding} {NOT_COLOR}")
    return frame


def depth(message: Message, header: Header) -> ImageFrame:
    """Translate a depth image."""
    return checked_depth(image(message, header))


def checked_depth(frame: ImageFrame) -> ImageFrame:
    """Return the frame; 16 bits of grey are millimetres here, whatever their driver calls them.

    Raises:
        SchemaError: its encoding is none of depth.

    """
    if frame.encoding == "mono16":
        return msgspec.structs.replace(frame, encoding="16UC1")
    if frame.encoding not in DEPTH_ENCODINGS:
        raise SchemaError(f"{frame.encoding} is no encoding of depth: use {' or '.join(sorted(DEPTH_ENCODINGS))}")
    return frame
