import numpy as np
import pytest

from gateway.ros1 import image as ros_image
from gateway.ros1.image import Image, encode_image
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.translators import images
from gateway.to_bus.translators.pixel_encoding import UNKNOWN, encoding_of
from tests.gateway.sensing import compressed, received
from tests.gateway.to_bus.translators.test_cloud_image import EMPTY, UNORDERED, colored
from tests.schemas.pictures import file_of


def raw(encoding: str) -> Message:
    sent = Image(1, 2, 3, "lens", 1, 1, encoding, is_bigendian=False, step=8, data=memoryview(bytes(8)))
    return received(ros_image.TYPE_NAME, encode_image(sent))


PNG = file_of(np.ones((2, 3), np.uint16), ".png")


@pytest.mark.parametrize(
    ("message", "encoding"),
    [
        (raw("rgb8"), "rgb8"),
        (raw("16UC1"), "16UC1"),
        (raw("16SC1"), "16UC1"),
        (raw("64FC1"), "32FC1"),
        (raw(""), UNKNOWN),
        (received(ros_image.TYPE_NAME, b"garbage"), UNKNOWN),
        (compressed("bgr8; jpeg compressed bgr8", PNG), "bgr8"),
        (compressed("16UC1; compressedDepth rvl", PNG), "16UC1"),
        (received(images.COMPRESSED_TYPE, b"garbage"), UNKNOWN),
        (colored(), "rgb8"),
        (UNORDERED, UNKNOWN),
        (EMPTY, ""),
        (colored(height=3), ""),
    ],
)
def test_a_message_tells_what_its_pixels_are(message: Message, encoding: str) -> None:
    assert encoding_of(message) == encoding
