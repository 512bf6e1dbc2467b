"""Whatever a ROS publisher sends, a stream makes a valid message of it or counts it as malformed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.ros1.image import TYPE_NAME, Image, encode_image
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.stream import MALFORMED
from gateway.to_bus.translators.encoding_conversion import CONVERTERS
from schemas import codec
from schemas.image import BYTES_PER_PIXEL
from tests.gateway import sensing
from tests.gateway.sensing import received
from tests.gateway.to_bus.translators.rvl_coding import rvl_of
from tests.gateway.to_bus.translators.translating import forward
from tests.schemas.pictures import file_of

uint32 = st.integers(0, 2**32 - 1)
small = st.integers(0, 8)
images = st.builds(
    Image,
    seq=uint32,
    stamp_s=uint32,
    stamp_ns=uint32,
    frame_id=st.text(max_size=20),
    height=small | uint32,
    width=small | uint32,
    encoding=st.sampled_from([*sorted(BYTES_PER_PIXEL), *CONVERTERS, ""]) | st.text(max_size=10),
    is_bigendian=st.booleans(),
    step=small | uint32,
    data=st.binary(max_size=64).map(memoryview),
)
SENT: list[tuple[str, Message]] = [
    ("front/info", sensing.camera_info()),
    ("front/points", sensing.point_cloud()),
    ("front/color", sensing.compressed("jpeg", file_of(np.zeros((2, 3), np.uint8), ".jpg"))),
    ("front/depth", sensing.compressed("16UC1; compressedDepth", bytes(12) + file_of(np.zeros((2, 3), "u2"), ".png"))),
    ("front/depth", sensing.compressed("16UC1; compressedDepth rvl", bytes(12) + rvl_of(np.ones((2, 3), np.uint16)))),
    ("front/depth", sensing.disparity(np.ones((2, 3), np.float32))),
    ("text/mode", sensing.text("ready")),
    ("ros/mode", sensing.text("ready")),
    ("tf", sensing.tf(sensing.transform("lens"), sensing.transform("lidar"))),
    ("tf_static", sensing.tf(sensing.transform("lens"), sensing.transform("lidar"))),
]

IDS = [
    f"{number}-{name}-{message.publisher.type.name.partition('/')[2]}" for number, (name, message) in enumerate(SENT)
]
by_stream = pytest.mark.parametrize(("name", "message"), SENT, ids=IDS)


def take(name: str, message: Message) -> None:
    stream = forward(name)
    made = stream.take(message, 0)
    status = stream.status(wanted=True, publishers=1, replaced=0, broken_links={})
    if made is None:
        assert (status.forwarded, status.dropped) == (0, {MALFORMED: 1})
    else:
        assert (status.forwarded, status.dropped) == (1, {})
        codec.decode(stream.kind.schema, codec.encode(made), stream.kind.encoding)


def changed(message: Message, data: st.DataObject) -> Message:
    """Return the message with bytes changed, and cut off or with something added."""
    sent = bytearray(message.data)
    for _ in range(data.draw(st.integers(1, 4))):
        sent[data.draw(st.integers(0, len(sent) - 1))] = data.draw(st.integers(0, 255))
    whole = bytes(sent) + data.draw(st.binary(max_size=8))
    return received(message.publisher.type.name, whole[: data.draw(st.integers(0, len(whole)))])


@by_stream
@given(sent=st.binary(max_size=300))
def test_arbitrary_bytes(name: str, message: Message, sent: bytes) -> None:
    take(name, received(message.publisher.type.name, sent))


@by_stream
@given(data=st.data())
def test_messages_with_bytes_changed_or_cut(name: str, message: Message, data: st.DataObject) -> None:
    take(name, changed(message, data))


@pytest.mark.parametrize("name", ["front/color", "front/depth"])
@given(sent=st.binary(max_size=300))
def test_arbitrary_bytes_as_images(name: str, sent: bytes) -> None:
    take(name, received(TYPE_NAME, sent))


@pytest.mark.parametrize("name", ["front/color", "front/depth"])
@given(image=images)
def test_images_with_any_fields(name: str, image: Image) -> None:
    take(name, received(TYPE_NAME, encode_image(image)))


@given(image=images, data=st.data())
def test_images_with_bytes_changed_or_cut(image: Image, data: st.DataObject) -> None:
    take("front/color", changed(received(TYPE_NAME, encode_image(image)), data))
