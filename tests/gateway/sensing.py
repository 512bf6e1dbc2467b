"""ROS messages of sensors for tests, each a type's name and its bytes."""

from typing import Any

import numpy as np

from gateway.ros1.messages import message_type, new_message, serialise
from gateway.ros1.subscriber import Message
from gateway.ros1.wire.tcpros import PublisherAccepted

STAMP_NS = 1_700_000_000_000_000_005


def received(name: str, data: bytes, callerid: str = "/camera", *, latching: bool = False) -> Message:
    """Return a message as a link delivers it."""
    kind = message_type(name)
    return Message(data, "http://robot:1/", PublisherAccepted(callerid, kind.topic_type, kind.definition, latching))


def stamp() -> Any:
    return new_message("builtin_interfaces/Time", sec=1_700_000_000, nanosec=5)


def ros_header(frame_id: str = "lens") -> Any:
    return new_message("std_msgs/Header", seq=7, stamp=stamp(), frame_id=frame_id)


def camera_info(**changes: Any) -> Message:
    """Return a calibrated camera's info."""
    name = "sensor_msgs/CameraInfo"
    roi = new_message("sensor_msgs/RegionOfInterest", x_offset=1, y_offset=2, height=3, width=4, do_rectify=True)
    fields: dict[str, Any] = {
        "header": ros_header(),
        "height": 480,
        "width": 640,
        "distortion_model": "plumb_bob",
        "D": np.array([0.1, -0.2, 0.0, 0.0, 0.5]),
        "K": np.arange(9.0),
        "R": np.eye(3).ravel(),
        "P": np.arange(12.0),
        "binning_x": 1,
        "binning_y": 2,
        "roi": roi,
    }
    return received(name, serialise(name, new_message(name, **{**fields, **changes})))


def point_cloud(**changes: Any) -> Message:
    """Return two rows of three points of x (float32) and ring (uint16), eight bytes apart."""
    name = "sensor_msgs/PointCloud2"
    fields = [
        new_message("sensor_msgs/PointField", name="x", offset=0, datatype=7, count=1),
        new_message("sensor_msgs/PointField", name="ring", offset=4, datatype=4, count=0),
    ]
    values: dict[str, Any] = {
        "header": ros_header("lidar"),
        "height": 2,
        "width": 3,
        "fields": fields,
        "is_bigendian": False,
        "point_step": 8,
        "row_step": 24,
        "data": np.arange(48, dtype=np.uint8),
        "is_dense": True,
    }
    return received(name, serialise(name, new_message(name, **{**values, **changes})))
