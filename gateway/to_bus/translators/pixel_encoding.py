"""The encoding of a message's pixels, before it is translated."""

import struct
from typing import Any, Final

from gateway.ros1 import image as ros_image
from gateway.ros1 import point_cloud as ros_point_cloud
from gateway.ros1.errors import MessageError
from gateway.ros1.messages import deserialise
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.translators import images, points
from gateway.to_bus.translators.encoding_conversion import AS_DEPTH

UNKNOWN: Final = "?"
IMAGES: Final = (ros_image.TYPE_NAME, images.COMPRESSED_TYPE)
CLOUDS: Final = (ros_point_cloud.TYPE_NAME,)


def encoding_of(message: Message) -> str:
    """Return the encoding of an image's pixels, or of the image in a cloud, after translation.

    UNKNOWN where an image does not say it, or a cloud is no picture; empty where the next message may tell more.
    """
    if message.publisher.type.name in CLOUDS:
        is_picture = points.shows_picture(message)
        return "" if is_picture is None else points.ENCODING if is_picture else UNKNOWN
    try:
        found = _said(message)
    except (MessageError, struct.error):
        return UNKNOWN
    return AS_DEPTH.get(found, found) or UNKNOWN


def _said(message: Message) -> str:
    if message.publisher.type.name == ros_image.TYPE_NAME:
        return ros_image.decode_image(message.data).encoding
    found: Any = deserialise(images.COMPRESSED_TYPE, message.data)
    said: str = found.format
    return said.partition(";")[0].strip()
