"""Where on the robot's ROS graph the results of its cameras are found. Pure."""

import re
from collections.abc import Collection, Mapping
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


def results_of(gateway: str, publishers: Mapping[str, Collection[str]]) -> list[str]:
    """Return the topics of the results that a gateway's node publishes, given all publishing nodes by topic."""
    return [topic for topic, nodes in publishers.items() if gateway in nodes and is_result(topic)]


def recorders(topics: Collection[str], subscribers: Mapping[str, Collection[str]]) -> list[str]:
    """Return the nodes that subscribe to all of several topics, as `rosbag record -a` does; given all, by topic."""
    found = [set(subscribers.get(topic, ())) for topic in topics]
    return sorted(set.intersection(*found)) if len(found) > 1 else []


def cure(recorder: str) -> str:
    """Return how a recorder is kept from making results wanted."""
    pattern = re.sub(r"_\d+$", "_.*", recorder)  # rosbag's number is another one each time
    return (
        f"`rosbag record -a -x '.*/{ROOT}/.*'` leaves results out; a gateway with --passive-subscribers '{pattern}' "
        "gives it those that others want"
    )
