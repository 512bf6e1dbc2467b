"""The ROS topics of a simulated robot, named as by the drivers of real sensors. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum, auto
from typing import Final

from gateway.ros1 import image, point_cloud

CAMERA_INFO: Final = "sensor_msgs/CameraInfo"
TF_MESSAGE: Final = "tf2_msgs/TFMessage"


class SimulatedStream(StrEnum):
    """Streams that a robot can publish. Transforms come with all of them."""

    COLOR = auto()
    DEPTH = auto()
    POINTS = auto()
    LIDAR = auto()


class Content(StrEnum):
    """The content of a topic's messages."""

    COLOR = auto()
    COLOR_INFO = auto()
    DEPTH = auto()
    DEPTH_INFO = auto()
    POINTS = auto()
    LIDAR = auto()
    TF = auto()
    TF_STATIC = auto()


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic below the robot's namespace."""

    name: str
    content: Content
    type: str
    latched: bool = False
    queue_size: int = 1


COLOR_TOPICS: Final = (
    Topic("camera/color/image_raw", Content.COLOR, image.TYPE_NAME),
    Topic("camera/color/camera_info", Content.COLOR_INFO, CAMERA_INFO),
)
ALIGNED_TOPICS: Final = (
    Topic("camera/aligned_depth_to_color/image_raw", Content.DEPTH, image.TYPE_NAME),
    Topic("camera/aligned_depth_to_color/camera_info", Content.DEPTH_INFO, CAMERA_INFO),
)
DEPTH_TOPICS: Final = (
    Topic("camera/depth/image_rect_raw", Content.DEPTH, image.TYPE_NAME),
    Topic("camera/depth/camera_info", Content.DEPTH_INFO, CAMERA_INFO),
)
POINTS_TOPICS: Final = (Topic("camera/depth/color/points", Content.POINTS, point_cloud.TYPE_NAME),)
LIDAR_TOPICS: Final = (Topic("velodyne_points", Content.LIDAR, point_cloud.TYPE_NAME),)
TF_TOPICS: Final = (
    Topic("tf_static", Content.TF_STATIC, TF_MESSAGE, latched=True),
    Topic("tf", Content.TF, TF_MESSAGE, queue_size=100),
)


def topics(streams: Sequence[SimulatedStream], *, aligned: bool) -> list[Topic]:
    """Return the topics of a robot with or without depth registered to colour."""
    return [*TF_TOPICS, *_sensors(streams, aligned=aligned)]


def _sensors(streams: Sequence[SimulatedStream], *, aligned: bool) -> Iterator[Topic]:
    if SimulatedStream.COLOR in streams:
        yield from COLOR_TOPICS
    if SimulatedStream.DEPTH in streams:
        yield from ALIGNED_TOPICS if aligned else DEPTH_TOPICS
    if SimulatedStream.POINTS in streams:
        yield from POINTS_TOPICS
    if SimulatedStream.LIDAR in streams:
        yield from LIDAR_TOPICS
