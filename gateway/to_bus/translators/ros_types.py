"""Assigns kinds, and so ROS types, to streams.

A new sensor type also needs `TYPES` in gateway/discovery/plan.py and `READERS` in candidates.py beside it.
"""

from typing import Final

from bus import QoS
from gateway.ros1 import image as ros_image
from gateway.ros1 import point_cloud as ros_point_cloud
from gateway.ros1.wire.tcpros import ANY
from gateway.to_bus.translators import camera_info, images, raw
from gateway.to_bus.translators import transforms as tf
from gateway.to_bus.translators.camera_info import camera_info as info
from gateway.to_bus.translators.images import color, depth
from gateway.to_bus.translators.points import cloud_image, point_cloud
from gateway.to_bus.translators.stream_kind import MIB, StreamKind, each
from schemas.camera_info import CameraInfo
from schemas.image import ImageFrame
from schemas.keys import ROS, TEXT, TF, TF_STATIC, SensorKey, Stream, StreamKey
from schemas.points import PointCloud
from schemas.ros import RawMessage, Text
from schemas.transforms import Transforms

_INFO: Final = StreamKind(CameraInfo, QoS.RESULT, {camera_info.TYPE_NAME: each(info)}, max_bytes=MIB // 16)

_KINDS: Final[dict[str, StreamKind]] = {
    Stream.COLOR: StreamKind(
        ImageFrame,
        QoS.IMAGE,
        {ros_image.TYPE_NAME: each(color), images.COMPRESSED_TYPE: each(images.compressed_color)},
    ),
    Stream.DEPTH: StreamKind(
        ImageFrame,
        QoS.IMAGE,
        {
            ros_image.TYPE_NAME: each(depth),
            images.COMPRESSED_TYPE: each(images.compressed_depth),
            images.DISPARITY_TYPE: each(images.disparity),
        },
    ),
    Stream.INFO: _INFO,
    Stream.DEPTH_INFO: _INFO,
    Stream.POINTS: StreamKind(PointCloud, QoS.IMAGE, {ros_point_cloud.TYPE_NAME: each(point_cloud)}),
    TF: StreamKind(Transforms, QoS.RESULT, dict.fromkeys(tf.TYPE_NAMES, each(tf.transforms)), max_bytes=4 * MIB),
    TF_STATIC: StreamKind(
        Transforms, QoS.RESULT, dict.fromkeys(tf.TYPE_NAMES, tf.StaticTransforms), max_bytes=4 * MIB, merges=True
    ),
    TEXT: StreamKind(Text, QoS.RESULT, {raw.STRING: each(raw.text)}, max_bytes=MIB),
    ROS: StreamKind(RawMessage, QoS.MESSAGE, {ANY: each(raw.raw)}),
}

_INFO_OF_RECTIFIED: Final = StreamKind(
    CameraInfo, QoS.RESULT, {camera_info.TYPE_NAME: each(camera_info.rectified_info)}, max_bytes=_INFO.max_bytes
)

_COLOR_OF_POINTS: Final = StreamKind(ImageFrame, QoS.IMAGE, {ros_point_cloud.TYPE_NAME: each(cloud_image)})


def kind_of(key: SensorKey, *, of_points: bool = False, of_rectified: bool = False) -> StreamKind:
    """Return the kind of a sensor's stream.

    of_points: it is the colours of a point cloud. of_rectified: it is the calibration of a rectified picture.
    """
    if of_points:
        return _COLOR_OF_POINTS
    if of_rectified:
        return _INFO_OF_RECTIFIED
    return _KINDS[key.stream if isinstance(key, StreamKey) else key.kind]
