"""What an image message says of its pixels, before it is translated."""

import struct
from typing import Any, Final

from gateway.ros1 import image as ros_image
from gateway.ros1.errors import MessageError
from gateway.ros1.messages import deserialise
from gateway.ros1.subscriber import Message
from gateway.translators import compressed_image

UNKNOWN: Final = "?"
TYPES: Final = (ros_image.TYPE_NAME, compressed_image.TYPE_NAME)


def encoding_of(message: Message) -> str:
    """Return the encoding of an image's pixels, compressed or not; UNKNOWN where the message does not say."""
    try:
        if message.publisher.type.name == ros_image.TYPE_NAME:
            return ros_image.decode_image(message.data).encoding or UNKNOWN
        found: Any = deserialise(compressed_image.TYPE_NAME, message.data)
    except (MessageError, struct.error):
        return UNKNOWN
    return found.format.partition(";")[0].strip() or UNKNOWN
