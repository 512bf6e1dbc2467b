from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.ros1.errors import MessageError
from gateway.ros1.image import Image, decode_image, encode_image
from gateway.ros1.messages import deserialise, new_message, serialise
from gateway.ros1.wire.text import MAX_TEXT_BYTES
from tests.gateway.ros1.golden.messages import IMAGE

uint32 = st.integers(0, 2**32 - 1)
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=40)
images = st.builds(
    Image,
    seq=uint32,
    stamp_s=uint32,
    stamp_ns=st.integers(0, 999_999_999),
    frame_id=texts,
    height=uint32,
    width=uint32,
    encoding=texts,
    is_bigendian=st.booleans(),
    step=uint32,
    data=st.binary(max_size=100).map(memoryview),
)


@given(images)
def test_agrees_with_rosbags(image: Image) -> None:
    message = encode_image(image)
    theirs = deserialise("sensor_msgs/Image", message)
    stamp = new_message("std_msgs/Header", seq=image.seq, stamp=theirs.header.stamp, frame_id=image.frame_id)
    same = new_message(
        "sensor_msgs/Image",
        header=stamp,
        height=image.height,
        width=image.width,
        encoding=image.encoding,
        is_bigendian=int(image.is_bigendian),
        step=image.step,
        data=np.frombuffer(image.data, np.uint8),
    )
    assert (theirs.header.stamp.sec % 2**32, theirs.header.stamp.nanosec) == (image.stamp_s, image.stamp_ns)
    assert serialise("sensor_msgs/Image", same) == message
    assert decode_image(message) == image


def test_image_of_rospy() -> None:
    image = decode_image(IMAGE[4:])
    assert image == Image(
        seq=1,
        stamp_s=1_700_000_000,
        stamp_ns=123_456_789,
        frame_id="camera_link",
        height=3,
        width=4,
        encoding="rgb8",
        is_bigendian=False,
        step=12,
        data=memoryview(bytes(range(36))),
    )
    assert image.stamp == 1_700_000_000_123_456_789
    assert encode_image(image) == IMAGE[4:]


def test_pixels_are_a_view_into_the_message() -> None:
    message = bytearray(IMAGE[4:])
    image = decode_image(message)
    message[-1] = 255
    assert image.data[-1] == 255


@pytest.mark.parametrize("size", range(len(IMAGE) - 4))
def test_message_cut_off_anywhere_is_refused(size: int) -> None:
    with pytest.raises(MessageError):
        decode_image(IMAGE[4 : 4 + size])


def test_bytes_after_the_message_are_refused() -> None:
    with pytest.raises(MessageError, match="announces 36"):
        decode_image(IMAGE[4:] + b"x")


def test_longest_text_and_one_byte_more() -> None:
    image = decode_image(IMAGE[4:])
    longest = image._replace(frame_id="x" * MAX_TEXT_BYTES)
    assert decode_image(encode_image(longest)) == longest
    with pytest.raises(MessageError):
        encode_image(image._replace(frame_id="x" * (MAX_TEXT_BYTES + 1)))


@pytest.mark.parametrize("changes", [{"seq": 2**32}, {"height": -1}, {"encoding": "\ud800"}])
def test_what_does_not_fit_is_refused(changes: dict[str, int | str]) -> None:
    with pytest.raises(MessageError):
        encode_image(decode_image(IMAGE[4:])._replace(**changes))  # type: ignore[arg-type]
