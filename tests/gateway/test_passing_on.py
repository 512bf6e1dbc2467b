"""What comes in as a ROS message goes out without its pixels or points being copied on the way."""

from collections.abc import Callable

import pytest

from bus import Pieces
from gateway.ros1.image import Image, encode_image
from gateway.ros1.point_cloud import PointCloud, PointField, encode_point_cloud
from gateway.ros1.tcpros.subscriber import Message
from gateway.ros1.wire.framing import SCRATCH_BYTES, FrameReceiver
from gateway.ros1.wire.tcpros import PublisherAccepted, TopicType
from gateway.to_bus.translators.images import image
from gateway.to_bus.translators.points import point_cloud
from schemas import codec
from schemas.header import MAX_LABEL, Header
from schemas.image import ImageFrame
from schemas.points import PointCloud as Points
from tests.bus.rooms import Room
from tests.gateway.ros1.wire.framed import feed, framed

SIDE = 160
HEADER = Header(robot="r", boot_id="", seq=0, stamp_ns=0, frame_id="", received_ns=0)
PUBLISHER = PublisherAccepted("/p", TopicType("*", "*"), "", latching=False)


def an_image(frame_id: str) -> bytes:
    return encode_image(
        Image(
            seq=0,
            stamp_s=0,
            stamp_ns=0,
            frame_id=frame_id,
            height=SIDE,
            width=SIDE,
            encoding="mono8",
            is_bigendian=False,
            step=SIDE,
            data=memoryview(bytes(SIDE * SIDE)),
        )
    )


def a_cloud(frame_id: str) -> bytes:
    cloud = PointCloud(
        stamp=0,
        frame_id=frame_id,
        height=1,
        width=SIDE * SIDE,
        fields=(PointField("x", 0, 7, 1),),
        is_bigendian=False,
        point_step=4,
        row_step=4 * SIDE * SIDE,
        data=memoryview(bytes(4 * SIDE * SIDE)),
        is_dense=True,
    )
    return encode_point_cloud(cloud, seq=0)


@pytest.mark.parametrize("frame_id", ["", "camera", "\u20ac" * MAX_LABEL])
@pytest.mark.parametrize(("made", "translate"), [(an_image, image), (a_cloud, point_cloud)])
def test_a_message_is_written_as_it_came(
    made: Callable[[str], bytes], translate: Callable[[Message, Header], ImageFrame | Points], frame_id: str
) -> None:
    message = made(frame_id)
    assert len(message) > SCRATCH_BYTES
    frames = feed(FrameReceiver(1 << 20), framed(*[message] * 4))  # there is a place for the third before it comes
    assert len(frames) == 4
    for frame in frames:
        translated = translate(Message(frame, "", PUBLISHER), HEADER)
        room = Room(len(codec.encode(translated)))
        Pieces(*codec.encode_in_pieces(translated)).write(room)
        assert room.written[0] is frame.obj
        assert room.memory == codec.encode(translated)
