"""Where on the robot's ROS graph the results of its cameras are found. Pure."""

from collections.abc import Mapping
from typing import Final

from gateway.nodes import ros_chunk
from schemas.keys import Stream

ROOT: Final = "ultralytics"
ALERTS_TOPIC: Final = f"{ROOT}/alerts"
RESULTS: Final[Mapping[Stream, str]] = {
    Stream.CLASSES: "detection/classes",
    Stream.DISTANCES: "detection/distance",
    Stream.OVERLAY_DETECTION: "detection/image",
    Stream.OVERLAY_SEGMENTATION: "segmentation/image",
    Stream.OBJECTS: "segmentation/points",
}
"""By stream: the topic below the namespace of a camera's results."""


def result_root(camera: str, *, first: bool) -> str:
    """Return the ROS namespace of a camera's results, relative to the gateway's; the first has no chunk of its own."""
    return ROOT if first else f"{ROOT}/{ros_chunk(camera)}"


def is_result(topic: str) -> bool:
    """Whether a topic is where gateways publish, in whatever namespace, so that none may take it for a sensor."""
    return ROOT in topic.split("/")
