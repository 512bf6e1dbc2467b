import logging
import struct

import pytest

from bus import QoS
from gateway.ros1.image import TYPE_NAME, Image, encode_image
from gateway.ros1.tcpros.subscriber import Message
from gateway.ros1.wire.tcpros import PublisherAccepted, TopicType
from gateway.to_bus.shaping.frame_rates import Instants, StreamRate
from gateway.to_bus.shaping.stream_output import OutputCounts
from gateway.to_bus.stream import MALFORMED, MISMATCH, StreamForward
from gateway.to_bus.translators import StreamKind, kind_of
from gateway.to_bus.translators.images import image
from gateway.to_bus.translators.stream_kind import each
from schemas import codec
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream, StreamKey, sensor_key
from schemas.status import BEYOND_USE, OVER_BUDGET, REPLACED_BEFORE_LINK, THINNED, StreamStatus
from tests.gateway.sensing import received, text

COLOR = StreamKey(CameraKey("r1", "front"), Stream.COLOR)


def message(
    *,
    height: int = 2,
    encoding: str = "rgb8",
    data: bytes = bytes(range(12)),
    frame_id: str = "lens",
    stamp_s: int = 1_700_000_000,
) -> Message:
    sent = encode_image(
        Image(
            seq=7,
            stamp_s=stamp_s,
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
    return received(TYPE_NAME, sent)


def garbage(data: bytes) -> Message:
    return received(TYPE_NAME, data)


@pytest.fixture
def forward() -> StreamForward:
    return StreamForward(COLOR, "/image", kind_of(COLOR), "boot")


def frame(made: codec.Message | None) -> ImageFrame:
    assert made is not None
    return codec.decode(ImageFrame, codec.encode(made), codec.encoding(ImageFrame))


def test_an_image_becomes_a_frame_with_its_stamp_and_ours(forward: StreamForward) -> None:
    made = frame(forward.take(message(), 99))
    assert (made.height, made.width, made.encoding, made.step) == (2, 2, "rgb8", 6)
    assert bytes(made.data) == bytes(range(12))
    header = made.header
    assert (header.robot, header.camera, header.boot_id, header.seq) == ("r1", "front", "boot", 0)
    assert (header.stamp_ns, header.received_ns, header.frame_id) == (1_700_000_000_000_000_005, 99, "lens")


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (garbage(b""), "not a sensor_msgs/Image"),
        (garbage(bytes(message().data[:-1])), "announces 12 bytes of pixels and holds 11"),
        (message(data=bytes(11)), "data does not fit: 11 bytes, step x height is 12"),
        (message(encoding="rgb9"), "unknown encoding: 'rgb9'"),
        (message(height=0), "absurd dimensions: 2x0 pixels"),
        (message(height=2**32 - 1), "absurd dimensions"),
        (garbage(struct.pack("<IIII", 0, 0, 0, 2**32 - 1)), "with a text of 4294967295 bytes"),
    ],
)
def test_a_malformed_image_costs_itself_only(
    forward: StreamForward, bad: Message, reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert frame(forward.take(message(), 1)).header.seq == 0
    with caplog.at_level(logging.WARNING):
        assert forward.take(bad, 2) is None
    assert reason in caplog.text
    assert "/image from /camera" in caplog.text
    assert frame(forward.take(message(), 3)).header.seq == 1
    assert forward.status(wanted=True, publishers=1, replaced=0, broken_links={}).dropped == {MALFORMED: 1}


@pytest.mark.parametrize("is_bigendian", [False, True])
def test_byte_order_travels(*, is_bigendian: bool) -> None:
    key = StreamKey(CameraKey("r1", "front"), Stream.DEPTH)
    forward = StreamForward(key, "/image", kind_of(key), "boot")
    depth = Image(1, 2, 3, "lens", 1, 2, "16UC1", is_bigendian, 4, memoryview(bytes(4)))
    made = frame(forward.take(received(TYPE_NAME, encode_image(depth)), 0))
    assert (made.encoding, made.is_bigendian) == ("16UC1", is_bigendian)


def test_every_message_is_accounted_for(forward: StreamForward) -> None:
    for each_message in (message(), garbage(b""), message(), message()):
        forward.take(each_message, 0)
    assert forward.status(wanted=True, publishers=2, replaced=1, broken_links={"refused": 3}) == StreamStatus(
        camera="front",
        stream="color",
        topic="/image",
        wanted=True,
        publishers=2,
        received=4,
        forwarded=2,
        dropped={MALFORMED: 1, REPLACED_BEFORE_LINK: 1},
        broken_links={"refused": 3},
    )


def test_a_long_frame_id_is_cut_to_what_the_contract_carries(forward: StreamForward) -> None:
    assert frame(forward.take(message(frame_id="x" * 300), 0)).header.frame_id == "x" * 256


@pytest.mark.parametrize(
    "other", [TopicType("std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1"), TopicType(TYPE_NAME, "0" * 32)]
)
def test_a_message_of_another_type_is_counted_as_that(forward: StreamForward, other: TopicType) -> None:
    wrong = Message(message().data, "", PublisherAccepted("/camera", other, "", latching=False))
    assert forward.take(wrong, 0) is None
    assert forward.status(wanted=True, publishers=1, replaced=0, broken_links={}).dropped == {MISMATCH: 1}


def test_a_message_longer_than_its_kind_allows_is_not_looked_at(caplog: pytest.LogCaptureFixture) -> None:
    longest = len(message().data)
    for limit, whole in ((longest, True), (longest - 1, False)):
        kind = StreamKind(ImageFrame, QoS.IMAGE, {TYPE_NAME: each(image)}, max_bytes=limit)
        assert (StreamForward(COLOR, "/image", kind, "boot").take(message(), 0) is not None) == whole
    assert f"{TYPE_NAME} of {longest} bytes, at most {longest - 1} are read" in caplog.text


def test_what_is_thinned_is_counted_and_takes_no_number() -> None:
    instants = Instants()
    forward = StreamForward(COLOR, "/image", kind_of(COLOR), "boot", StreamRate(lambda: instants, "color", 0.5))
    taken = [forward.take(message(stamp_s=1_700_000_000 + n), n * 1_000_000_000) for n in range(5)]
    assert [frame(made).header.seq for made in taken if made is not None] == [0, 1, 2]
    assert [made is None for made in taken] == [False, True, False, True, False]
    status = forward.status(wanted=True, publishers=1, replaced=0, broken_links={})
    assert (status.received, status.forwarded, status.dropped) == (5, 3, {THINNED: 2})


def test_what_nobody_can_use_is_counted_as_that_and_takes_no_number() -> None:
    instants = Instants()
    rate_limiter = StreamRate(lambda: instants, "color", None)
    forward = StreamForward(
        COLOR, "/image", kind_of(COLOR), "boot", rate_limiter, useful=lambda now_ns: now_ns % 2 == 0
    )
    taken = [forward.take(message(stamp_s=1_700_000_000 + n), n) for n in range(5)]
    assert [frame(made).header.seq for made in taken if made is not None] == [0, 1, 2]
    status = forward.status(wanted=True, publishers=1, replaced=0, broken_links={})
    assert (status.received, status.forwarded, status.dropped) == (5, 3, {BEYOND_USE: 2})


def test_messages_without_a_stamp_are_thinned_by_their_arrival() -> None:
    key = sensor_key("r1", "ros/mode")
    instants = Instants()
    forward = StreamForward(key, "/mode", kind_of(key), "boot", StreamRate(lambda: instants, "ros/mode", 10))
    taken = [forward.take(text("ready"), 1_700_000_000_000_000_000 + n * 50_000_000) for n in range(6)]
    assert [made is not None for made in taken] == [True, False] * 3


def test_what_the_output_lost_was_not_forwarded(forward: StreamForward) -> None:
    def status_at(now_s: int) -> StreamStatus:
        forward.take(message(), 0)
        return forward.status(
            wanted=True,
            publishers=1,
            replaced=1,
            broken_links={},
            output=OutputCounts({OVER_BUDGET: 1, MALFORMED: 0}, 77, "jpeg:80"),
            now_ns=now_s * 1_000_000_000,
        )

    *_, status = [status_at(now_s) for now_s in range(4)]
    assert (status.received, status.forwarded, status.bytes, status.compression) == (4, 2, 77, "jpeg:80")
    assert status.dropped == {OVER_BUDGET: 1, REPLACED_BEFORE_LINK: 1}
    assert (status.received_hz, status.forwarded_hz) == (1, 1)
