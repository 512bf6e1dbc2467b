import logging
import struct

import pytest

from gateway.ros1.image import Image, encode_image
from gateway.stream import MALFORMED, REPLACED, StreamForward
from gateway.translators import IMAGE_TRANSLATOR
from schemas import codec
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from schemas.status import StreamStatus


def message(
    *, height: int = 2, encoding: str = "rgb8", data: bytes = bytes(range(12)), frame_id: str = "lens"
) -> bytes:
    return encode_image(
        Image(
            seq=7,
            stamp_s=1_700_000_000,
            stamp_ns=5,
            frame_id=frame_id,
            height=height,
            width=2,
            encoding=encoding,
            is_bigendian=False,
            step=6,
            data=memoryview(data),
        )
    )


@pytest.fixture
def forward() -> StreamForward:
    return StreamForward(CameraKey("r1", "front"), Stream.COLOR, "/image", IMAGE_TRANSLATOR, "boot")


def frame(payload: bytes | None) -> ImageFrame:
    assert payload is not None
    return codec.decode(ImageFrame, payload, codec.encoding(ImageFrame))


def test_an_image_becomes_a_frame_with_its_stamp_and_ours(forward: StreamForward) -> None:
    made = frame(forward.take(message(), "/camera", 99))
    assert (made.height, made.width, made.encoding, made.step) == (2, 2, "rgb8", 6)
    assert bytes(made.data) == bytes(range(12))
    header = made.header
    assert (header.robot, header.camera, header.boot_id, header.seq) == ("r1", "front", "boot", 0)
    assert (header.stamp_ns, header.received_ns, header.frame_id) == (1_700_000_000_000_000_005, 99, "lens")


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (b"", "not a sensor_msgs/Image"),
        (message()[:-1], "announces 12 bytes of pixels and holds 11"),
        (message(data=bytes(11)), "data does not fit: 11 bytes, step x height is 12"),
        (message(encoding="rgb9"), "unknown encoding: 'rgb9'"),
        (message(height=0), "absurd dimensions: 2x0 pixels"),
        (message(height=2**32 - 1), "absurd dimensions"),
        (struct.pack("<IIII", 0, 0, 0, 2**32 - 1), "with a text of 4294967295 bytes"),
    ],
)
def test_a_malformed_image_costs_itself_only(
    forward: StreamForward, bad: bytes, reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert frame(forward.take(message(), "/camera", 1)).header.seq == 0
    with caplog.at_level(logging.WARNING):
        assert forward.take(bad, "/camera", 2) is None
    assert reason in caplog.text
    assert "/image from /camera" in caplog.text
    assert frame(forward.take(message(), "/camera", 3)).header.seq == 1
    assert forward.status(wanted=True, publishers=1, replaced=0, broken_links={}).dropped == {MALFORMED: 1}


@pytest.mark.parametrize("is_bigendian", [False, True])
def test_byte_order_travels(forward: StreamForward, *, is_bigendian: bool) -> None:
    depth = Image(1, 2, 3, "lens", 1, 2, "16UC1", is_bigendian, 4, memoryview(bytes(4)))
    made = frame(forward.take(encode_image(depth), "/camera", 0))
    assert (made.encoding, made.is_bigendian) == ("16UC1", is_bigendian)


def test_every_message_is_accounted_for(forward: StreamForward) -> None:
    for data in (message(), b"", message(), message()):
        forward.take(data, "/camera", 0)
    assert forward.status(wanted=True, publishers=2, replaced=1, broken_links={"refused": 3}) == StreamStatus(
        camera="front",
        stream="color",
        topic="/image",
        wanted=True,
        publishers=2,
        received=4,
        forwarded=2,
        dropped={MALFORMED: 1, REPLACED: 1},
        broken_links={"refused": 3},
    )


def test_a_long_frame_id_is_cut_to_what_the_contract_carries(forward: StreamForward) -> None:
    assert frame(forward.take(message(frame_id="x" * 300), "/camera", 0)).header.frame_id == "x" * 256
