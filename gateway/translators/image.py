"""sensor_msgs/Image to ImageFrame."""

from gateway.ros1.image import decode_image
from gateway.ros1.subscriber import Message
from gateway.translators.stream_kind import stamped
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.image import DEPTH_ENCODINGS, ImageFrame


def image(message: Message, header: Header) -> ImageFrame:
    """Translate an image of any encoding."""
    return _frame(message, header)


def depth(message: Message, header: Header) -> ImageFrame:
    """Translate a depth image."""
    frame = _frame(message, header)
    if frame.encoding not in DEPTH_ENCODINGS:
        raise SchemaError(f"{frame.encoding} is no encoding of depth: use {' or '.join(sorted(DEPTH_ENCODINGS))}")
    return frame


def _frame(message: Message, header: Header) -> ImageFrame:
    found = decode_image(message.data)
    return ImageFrame(
        header=stamped(header, found.stamp, found.frame_id),
        height=found.height,
        width=found.width,
        encoding=found.encoding,
        step=found.step,
        data=found.data,
        is_bigendian=found.is_bigendian,
    )
