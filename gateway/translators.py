"""ROS 1 messages to the fleet's own: one translator per message type."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import msgspec

from gateway.ros1.image import TYPE_NAME as IMAGE
from gateway.ros1.image import decode_image
from schemas import codec
from schemas.header import Header
from schemas.image import ImageFrame

Bytes = bytes | bytearray | memoryview

MAX_FRAME_ID: Final = 256


@dataclass(frozen=True, slots=True)
class Translator:
    """Makes messages of one schema from one ROS type.

    translate: given a serialised ROS message and a header without stamp and frame_id, returns the payload to publish.
        Raises MessageError or SchemaError for bytes that are not such a message.
    """

    ros_type: str
    encoding: str
    translate: Callable[[Bytes, Header], bytes]


def image(message: Bytes, header: Header) -> bytes:
    """Translate a sensor_msgs/Image to an ImageFrame."""
    found = decode_image(message)
    return codec.encode(
        ImageFrame(
            header=msgspec.structs.replace(header, stamp_ns=found.stamp, frame_id=found.frame_id[:MAX_FRAME_ID]),
            height=found.height,
            width=found.width,
            encoding=found.encoding,
            step=found.step,
            data=found.data,
            is_bigendian=found.is_bigendian,
        )
    )


IMAGE_TRANSLATOR: Final = Translator(IMAGE, codec.encoding(ImageFrame), image)
