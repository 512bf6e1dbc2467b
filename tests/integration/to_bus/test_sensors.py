"""One message of every sensor type from Debian's rospy, through a real gateway, to a subscriber on Zenoh."""

import math
import struct
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Any, Generic

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from schemas import keys
from schemas.camera_info import CameraInfo
from schemas.codec import M
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.points import PointCloud, PointField
from schemas.ros import RawMessage, Text
from schemas.transforms import Transforms
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import PEERS, RosEnvironment, require_ros
from tests.schemas.pictures import file_of

SCRIPT = (PEERS / "rospy_sensors.py").read_text(encoding="utf-8")
STAMP_NS = 1_700_000_000_500_000_000


@dataclass(frozen=True)
class Sensor(Generic[M]):
    """A stream, the topic it comes from, and what arrives on it."""

    name: str
    topic: str
    schema: type[M]
    holds: Callable[[M], None]


def holds_depth(frame: ImageFrame) -> None:
    assert stamped(frame.header, "front")
    assert (frame.height, frame.width, frame.encoding, frame.is_bigendian, frame.step) == (1, 2, "16UC1", True, 4)
    assert struct.unpack(">2H", frame.data) == (0, 2310)


def holds_file(camera: str, kind: str, encoding: str, file: bytes) -> Callable[[ImageFrame], None]:
    def holds(frame: ImageFrame) -> None:
        assert stamped(frame.header, camera)
        assert (frame.height, frame.width, frame.format, frame.encoding) == (4, 6, kind, encoding)
        assert bytes(frame.data) == file

    return holds


def holds_disparity(frame: ImageFrame) -> None:
    assert stamped(frame.header, "stereo")
    assert (frame.height, frame.width, frame.encoding, frame.step) == (1, 2, "32FC1", 8)
    known, unknown = struct.unpack("<2f", frame.data)
    assert known == 2.0
    assert math.isnan(unknown)


def holds_info(info: CameraInfo) -> None:
    assert stamped(info.header, "front")
    assert (info.height, info.width, info.distortion_model) == (480, 640, "plumb_bob")
    assert info.d == [0.5, -0.25, 0, 0, 0]
    assert info.k == [600, 0, 320, 0, 601, 240, 0, 0, 1]
    assert info.r == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    assert info.p == [600, 0, 320, 0, 0, 601, 240, 0, 0, 0, 1, 0]


def holds_points(cloud: PointCloud) -> None:
    assert stamped(cloud.header, "front")
    assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (1, 2, 12, 24)
    assert cloud.fields == [PointField("x", 0, 7), PointField("y", 4, 7), PointField("z", 8, 7)]
    *numbers, last = struct.unpack("<6f", cloud.data)
    assert numbers == [1, 2, 3, 4, 5]
    assert math.isnan(last)
    assert (cloud.is_bigendian, cloud.is_dense) == (False, False)


def holds_transform_of(child: str) -> Callable[[Transforms], None]:
    def holds(sent: Transforms) -> None:
        assert (sent.header.camera, sent.header.stamp_ns) == ("", 0)
        (only,) = sent.transforms
        assert (only.frame_id, only.child_frame_id, only.stamp_ns) == ("sensor", child, STAMP_NS)
        assert (only.translation, only.rotation) == ((1, 2, 3), (0, 0, 0.6, 0.8))

    return holds


def holds_text(sent: Text) -> None:
    assert (sent.header.camera, sent.header.stamp_ns) == ("", 0)
    assert sent.text == "ready for Kisten und Kästen"


def holds_battery(sent: RawMessage) -> None:
    assert (sent.header.camera, sent.type, sent.latched) == ("", "sensor_msgs/BatteryState", False)
    assert sent.md5 == "4ddae7f048e32fda22cac764685e3974"
    assert "float32 percentage" in sent.definition
    assert "MSG: std_msgs/Header" in sent.definition
    battery: Any = get_typestore(Stores.ROS1_NOETIC).deserialize_ros1(bytes(sent.data), "sensor_msgs/msg/BatteryState")
    assert (battery.percentage, battery.location, battery.header.frame_id) == (0.5, "left", "sensor")


def stamped(header: Header, camera: str) -> bool:
    return (header.camera, header.stamp_ns, header.frame_id) == (camera, STAMP_NS, "sensor")


JPEG = file_of(np.zeros((4, 6, 3), np.uint8), ".jpg")
PNG = file_of(np.arange(24, dtype=np.uint16).reshape(4, 6), ".png")

SENSORS: list[Sensor[Any]] = [
    Sensor("front/color", "/front/color/image_raw/compressed", ImageFrame, holds_file("front", "jpeg", "rgb8", JPEG)),
    Sensor("rear/depth", "/rear/depth/image_raw/compressedDepth", ImageFrame, holds_file("rear", "png", "16UC1", PNG)),
    Sensor("stereo/depth", "/stereo/disparity", ImageFrame, holds_disparity),
    Sensor("front/depth", "/front/depth/image_raw", ImageFrame, holds_depth),
    Sensor("front/info", "/front/color/camera_info", CameraInfo, holds_info),
    Sensor("front/points", "/front/depth/points", PointCloud, holds_points),
    Sensor("text/mode", "/mode", Text, holds_text),
    Sensor("ros/battery", "/battery", RawMessage, holds_battery),
    Sensor("tf", "/tf", Transforms, holds_transform_of("moving")),
    Sensor("tf_static", "/tf_static", Transforms, holds_transform_of("fixed")),
]


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def arrives(rig: FleetRig, sensor: Sensor[M]) -> None:
    key = keys.sensor_key("r1", sensor.name)
    async with rig.subscribed(str(key)) as samples:
        message = await receive(samples, sensor.schema)
    sensor.holds(message)


@pytest.mark.timeout(180)
async def test_every_sensor_message_arrives_as_it_was_sent(ros: RosEnvironment, rig: FleetRig) -> None:
    require_ros("stereo_msgs", "tf2_msgs")
    topics = [option for sensor in SENSORS for option in ("--topics", f"{sensor.name}={sensor.topic}")]
    await rig.gateway("r1", ros.master_uri, {"other": "/other/color/image_raw"}, *topics, "--compression", "raw")
    sensors = await ros.script(SCRIPT, JPEG.hex(), PNG.hex())
    await sensors.until_output("sensors up")
    for sensor in SENSORS:
        await arrives(rig, sensor)
