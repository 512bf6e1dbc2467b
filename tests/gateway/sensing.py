"""ROS messages of sensors for tests, each a type's name and its bytes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.ros1.messages import Time, message_type, new_message, serialise
from gateway.ros1.tcpros.subscriber import Message
from gateway.ros1.wire.tcpros import PublisherAccepted

STAMP_NS = 1_700_000_000_000_000_005


def received(name: str, data: bytes, callerid: str = "/camera", *, latching: bool = False) -> Message:
    """Return a message as a link delivers it."""
    kind = message_type(name)
    return Message(data, "http://robot:1/", PublisherAccepted(callerid, kind.topic_type, kind.definition, latching))


def stamp() -> Any:
    return Time(1_700_000_000, 5)


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


def transform(child: str, *, parent: str = "base_link", x: float = 0.0) -> Any:
    moved = new_message(
        "geometry_msgs/Transform",
        translation=new_message("geometry_msgs/Vector3", x=x, y=2.0, z=3.0),
        rotation=new_message("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.6, w=0.8),
    )
    return new_message(
        "geometry_msgs/TransformStamped", header=ros_header(parent), child_frame_id=child, transform=moved
    )


def tf(*transforms: Any, callerid: str = "/localiser", name: str = "tf2_msgs/TFMessage") -> Message:
    """Return a message of transforms."""
    return received(name, serialise(name, new_message(name, transforms=list(transforms))), callerid)


def compressed(said: str, file: bytes) -> Message:
    """Return a compressed image with what its publisher says of the format."""
    name = "sensor_msgs/CompressedImage"
    fields = {"header": ros_header(), "format": said, "data": np.frombuffer(file, np.uint8)}
    return received(name, serialise(name, new_message(name, **fields)))


def disparity(pixels: NDArray[np.float32], *, padding: int = 0, is_bigendian: bool = False, **changes: Any) -> Message:
    """Return what a stereo camera of 500 pixels and 0.1 m sees; `changes` go to the message or to its image."""
    name = "stereo_msgs/DisparityImage"
    rows = pixels.astype(">f4" if is_bigendian else "<f4").view(np.uint8).reshape(pixels.shape[0], -1)
    data = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    fields: dict[str, Any] = {
        "header": ros_header(),
        "height": pixels.shape[0],
        "width": pixels.shape[1],
        "encoding": "32FC1",
        "is_bigendian": int(is_bigendian),
        "step": data.shape[1],
        "data": data.ravel(),
    }
    image = new_message("sensor_msgs/Image", **{**fields, **{key: changes[key] for key in changes.keys() & fields}})
    window = new_message("sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    whole: dict[str, Any] = {
        "header": ros_header(),
        "image": image,
        "f": 500.0,
        "T": 0.1,
        "valid_window": window,
        "min_disparity": 0.0,
        "max_disparity": 128.0,
        "delta_d": 0.0625,
    }
    changed = {key: changes[key] for key in changes.keys() & (whole.keys() - {"header", "image"})}
    return received(name, serialise(name, new_message(name, **{**whole, **changed})))


def text(data: str) -> Message:
    name = "std_msgs/String"
    return received(name, serialise(name, new_message(name, data=data)))
