import struct
from typing import Any

import msgspec
import numpy as np
import pytest
import simplejpeg
from numpy.typing import NDArray

from gateway.ros1 import image as ros_image
from gateway.ros1.errors import MessageError
from gateway.ros1.messages import deserialise
from gateway.to_ros.outputs import image
from schemas.errors import SchemaError
from schemas.image import ImageFrame
from tests.gateway.to_ros.overlays import BLUE, RED, overlay
from tests.schemas import frames

TOLERANCE = 12
"""How far JPEG takes a colour from itself."""


def sent(frame: ImageFrame, number: int = 1) -> Any:
    return deserialise(ros_image.TYPE_NAME, image(frame, number))


def pixels(message: Any, channels: int = 3) -> NDArray[np.int64]:
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
    return rows[:, : message.width * channels].reshape(message.height, message.width, channels).astype(int)


@pytest.mark.parametrize(("height", "width"), [(48, 64), (1, 2), (17, 31), (480, 640)])
def test_a_jpeg_becomes_rgb8_pixels_in_the_right_order(height: int, width: int) -> None:
    message = sent(overlay(height=height, width=width))
    assert (message.height, message.width, message.encoding, message.step) == (height, width, "rgb8", width * 3)
    assert message.data.size == height * width * 3
    if width >= 32:
        assert abs(pixels(message)[:, : width // 4] - RED).max() <= TOLERANCE
        assert abs(pixels(message)[:, -(width // 4) :] - BLUE).max() <= TOLERANCE


def test_stamp_and_frame_are_the_sources_and_seq_is_the_topics() -> None:
    frame = overlay(seq=5)
    message = sent(frame, number=3)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 5)
    assert message.header.frame_id == frame.header.frame_id
    assert message.header.seq == 3


def test_a_grey_jpeg_becomes_mono8() -> None:
    grey = simplejpeg.encode_jpeg(np.full((8, 16, 1), 100, np.uint8), colorspace="GRAY")
    message = sent(
        msgspec.structs.replace(overlay(height=8, width=16), encoding="mono8", step=16, data=memoryview(grey))
    )
    assert (message.encoding, message.step) == ("mono8", 16)
    assert abs(pixels(message, 1) - 100).max() <= TOLERANCE


def test_raw_pixels_go_as_they_are() -> None:
    frame = msgspec.structs.replace(
        frames.image(height=4, width=6), encoding="bgr8", step=20, data=memoryview(bytes(80))
    )
    message = sent(frame)
    assert (message.encoding, message.step, message.data.size) == ("bgr8", 20, 80)


def changed(frame: ImageFrame, at: int, data: bytes) -> ImageFrame:
    file = bytearray(frame.data)
    file[at : at + len(data)] = data
    return msgspec.structs.replace(frame, data=memoryview(bytes(file)))


def test_a_file_that_is_cut_off_is_refused() -> None:
    frame = overlay()
    for size in (200, frame.data.nbytes // 2, frame.data.nbytes - 2):
        with pytest.raises(SchemaError, match=r"cannot be decoded|cut off"):
            image(msgspec.structs.replace(frame, data=frame.data[:size]), 1)


def test_a_file_that_says_two_sizes_is_refused_before_it_is_decoded() -> None:
    frame = overlay()
    at = bytes(frame.data).index(b"\xff\xc0")
    second = frame.data[at : at + 5].tobytes() + struct.pack(">HH", 16_000, 16_000) + frame.data[at + 9 : at + 19]
    doubled = frame.data[: at + 19].tobytes() + second + frame.data[at + 19 :].tobytes()
    with pytest.raises(SchemaError, match="scans go over"):
        image(msgspec.structs.replace(frame, data=memoryview(doubled)), 1)


def test_a_file_of_a_subsampling_that_nobody_uses_is_refused() -> None:
    frame = overlay()
    sampling = bytes(frame.data).index(b"\xff\xc0") + 11
    with pytest.raises(SchemaError, match="cannot be decoded"):
        image(changed(frame, sampling, b"\x14"), 1)


def test_a_file_whose_pixels_are_not_what_the_frame_says_is_refused_by_the_contract() -> None:
    with pytest.raises(SchemaError, match="64x49 pixels, the file has 64x48"):
        msgspec.structs.replace(overlay(), height=49)


def test_another_format_is_refused() -> None:
    png = b"\x89PNG\r\n\x1a\n\x00\x00\x00\x0dIHDR" + struct.pack(">IIBB", 64, 48, 8, 2)
    with pytest.raises(SchemaError, match="as png of rgb8 pixels: only raw and JPEG"):
        image(msgspec.structs.replace(overlay(), format="png", data=memoryview(png)), 1)


def test_a_stamp_that_ros_cannot_say_is_refused() -> None:
    frame = overlay()
    late = msgspec.structs.replace(frame, header=msgspec.structs.replace(frame.header, stamp_ns=2**32 * 10**9))
    with pytest.raises(MessageError, match="cannot serialise"):
        image(late, 1)
