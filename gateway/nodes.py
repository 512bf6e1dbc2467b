"""What gateways and robots are called on a ROS graph. Pure."""

import re
from typing import Final

PREFIX: Final = "fleetsight_gateway_"


def ros_chunk(name: str) -> str:
    """Return a name of ours as a chunk of a ROS name can have it; several names may become one."""
    return re.sub("[^A-Za-z0-9_]", "_", name)


def node_name(robot: str, boot_id: str) -> str:
    """Return a ROS node name that no other process has: a master ends the older of two namesakes."""
    return f"{PREFIX}{ros_chunk(robot)}_{boot_id[:8]}"


def is_of(node: str, robot: str) -> bool:
    """Whether a ROS node, by its global name, is a gateway of the robot that `node_name` named."""
    return re.fullmatch(f"{PREFIX}{ros_chunk(robot)}_[0-9a-f]{{8}}", node.rpartition("/")[2]) is not None


def is_gateway(node: str) -> bool:
    """Whether a ROS node is a gateway, this robot's or another one's, by its global name."""
    return node.rpartition("/")[2].startswith(PREFIX)
