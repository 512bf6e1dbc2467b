"""Where on the robot's ROS graph the results of its cameras are found. Pure."""

import re
from typing import Final

ROOT: Final = "ultralytics"
ALERTS_TOPIC: Final = f"{ROOT}/alerts"


def result_root(camera: str, *, first: bool) -> str:
    """Return the ROS namespace of a camera's results, relative to the gateway's; the first has no chunk of its own."""
    return ROOT if first else f"{ROOT}/{re.sub('[^A-Za-z0-9_]', '_', camera)}"


def is_result(topic: str) -> bool:
    """Whether a topic is where gateways publish, in whatever namespace, so that none may take it for a sensor."""
    return ROOT in topic.split("/")
