import pytest

from gateway.doctor.topic_probe import stamp_at, stamp_offset, translated
from gateway.ros1.messages import message_type
from gateway.ros1.tcpros.subscriber import Message
from gateway.ros1.wire.tcpros import PublisherAccepted, TopicType
from gateway.to_bus.translators import kind_of
from schemas.camera_info import CameraInfo
from schemas.keys import sensor_key
from schemas.points import PointCloud
from schemas.ros import RawMessage
from tests.gateway.sensing import STAMP_NS, camera_info, point_cloud, received, text, tf

INFO = sensor_key("r1", "front/info")
MODE = sensor_key("r1", "ros/mode")


@pytest.mark.parametrize(
    ("definition", "offset"),
    [
        (message_type("sensor_msgs/Image").definition, 4),
        (message_type("sensor_msgs/CameraInfo").definition, 4),
        (message_type("stereo_msgs/DisparityImage").definition, 4),
        (message_type("rosgraph_msgs/Clock").definition, 0),
        (message_type("tf2_msgs/TFMessage").definition, None),
        (message_type("std_msgs/String").definition, None),
        ("# comment\nuint8 MODE=1 # one\n\nstd_msgs/Header header\n", 4),
        ("Header[] headers", None),
        ("================\nMSG: std_msgs/Header\nHeader header", None),
        ("", None),
    ],
)
def test_where_a_type_has_its_stamp(definition: str, offset: int | None) -> None:
    assert stamp_offset(definition) == offset


def test_stamps_of_real_messages() -> None:
    assert stamp_at(camera_info().data, 4) == STAMP_NS
    assert stamp_at(point_cloud().data, 4) == STAMP_NS


@pytest.mark.parametrize(("size", "expected"), [(12, 0), (11, None), (0, None)])
def test_a_message_too_short_for_a_stamp(size: int, expected: int | None) -> None:
    assert stamp_at(bytes(size), 4) == expected


def test_a_message_is_read_as_the_gateway_would() -> None:
    found = translated(INFO, kind_of(INFO), camera_info(), 7)
    assert isinstance(found, CameraInfo)
    assert (found.header.camera, found.header.stamp_ns, found.header.received_ns) == ("front", STAMP_NS, 7)


def test_a_message_of_any_type_fits_an_envelope() -> None:
    assert isinstance(translated(MODE, kind_of(MODE), text("x"), 0), RawMessage)


def test_a_message_of_another_type_or_version_is_told_elsewhere() -> None:
    assert translated(INFO, kind_of(INFO), tf(), 0) == ""
    old = PublisherAccepted("/camera", TopicType("sensor_msgs/CameraInfo", "0" * 32), "", latching=False)
    assert translated(INFO, kind_of(INFO), Message(camera_info().data, "http://robot:1/", old), 0) == ""


@pytest.mark.parametrize(
    ("data", "why"), [(b"", "0 bytes are not a sensor_msgs/CameraInfo"), (bytes(1 << 17), "131072 bytes, at most")]
)
def test_a_message_that_cannot_be_read(data: bytes, why: str) -> None:
    assert str(translated(INFO, kind_of(INFO), received("sensor_msgs/CameraInfo", data), 0)).startswith(why)


def test_a_message_that_the_gateway_repairs_can_be_read() -> None:
    points = sensor_key("r1", "lidar/points")
    found = translated(points, kind_of(points), point_cloud(row_step=0), 0)
    assert isinstance(found, PointCloud)
    assert found.row_step == 24
