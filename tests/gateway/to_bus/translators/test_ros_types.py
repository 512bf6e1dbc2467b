from typing import Any

import numpy as np
import pytest

from bus import QoS
from gateway.ros1.image import TYPE_NAME, Image, encode_image
from gateway.ros1.messages import message_type
from gateway.to_bus.translators import kind_of
from schemas import codec, keys
from schemas.camera_info import CameraInfo
from schemas.codec import Message
from schemas.image import ImageFrame
from schemas.points import PointCloud
from schemas.ros import RawMessage, Text
from schemas.transforms import Transforms
from tests.gateway import sensing
from tests.gateway.to_bus.translators.translating import translated
from tests.schemas.pictures import file_of

KINDS: dict[str, tuple[type[Message], QoS, str]] = {
    "front/color": (ImageFrame, QoS.IMAGE, "*"),
    "front/depth": (ImageFrame, QoS.IMAGE, "*"),
    "front/info": (CameraInfo, QoS.RESULT, "sensor_msgs/CameraInfo"),
    "front/depth_info": (CameraInfo, QoS.RESULT, "sensor_msgs/CameraInfo"),
    "front/points": (PointCloud, QoS.IMAGE, "sensor_msgs/PointCloud2"),
    "tf": (Transforms, QoS.RESULT, "*"),
    "tf_static": (Transforms, QoS.RESULT, "*"),
    "text/mode": (Text, QoS.RESULT, "std_msgs/String"),
    "ros/battery": (RawMessage, QoS.MESSAGE, "*"),
}


def test_every_stream_that_sensors_send_is_covered() -> None:
    named = {f"front/{stream}" for stream in keys.SENSOR_STREAMS} | keys.ROBOT_STREAMS
    assert named == {name for name in KINDS if name.partition("/")[0] not in keys.NAMED_STREAMS}


PIXELS = memoryview(bytes(6))
HEADED = {
    "front/color": sensing.compressed("jpeg", file_of(np.zeros((2, 3), np.uint8), ".jpg")),
    "front/depth": sensing.disparity(np.ones((2, 3), np.float32)),
    "front/info": sensing.camera_info(),
    "front/points": sensing.point_cloud(header=sensing.ros_header("lens")),
    "rear/color": sensing.received(
        TYPE_NAME, encode_image(Image(1, 2, 3, "lens", 2, 3, "mono8", is_bigendian=False, step=3, data=PIXELS))
    ),
}


@pytest.mark.parametrize("name", HEADED)
def test_a_frame_id_that_is_not_utf8_costs_no_message(name: str) -> None:
    sent = HEADED[name]
    latin = sensing.received(sent.publisher.type.name, bytes(sent.data).replace(b"lens", b"l\xe4ns"))
    made: Any = translated(kind_of(keys.sensor_key("r1", name)).schema, name, latin)
    assert made.header.frame_id == "l\ufffdns"


@pytest.mark.parametrize("name", KINDS)
def test_a_stream_carries_one_schema_of_known_ros_types(name: str) -> None:
    schema, qos, ros_type = KINDS[name]
    kind = kind_of(keys.sensor_key("r1", name))
    assert (kind.schema, kind.qos, kind.ros_type) == (schema, qos, ros_type)
    assert kind.encoding == codec.encoding(schema)
    assert all(message_type(each).md5sum for each in kind.translators)
