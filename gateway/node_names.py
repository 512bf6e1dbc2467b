"""Names of gateways and robots on a ROS graph, and the stale registrations of gateways that were killed."""

import logging
import re
from contextlib import aclosing
from typing import Final

from gateway.ros1.errors import Ros1Error
from gateway.ros1.master import SystemState
from gateway.ros1.node import Node

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


log = logging.getLogger(__name__)


async def clear_predecessors(node: Node, robot: str) -> None:
    """Once the master has answered, unregister the robot's gateways that are dead, but for those with a name given."""
    async with aclosing(node.looks()) as looks:
        look = await anext(looks)
    for name in sorted(look.state.nodes() - {node.name}):
        if is_of(name, robot):
            await _clear(node, name, look.state)


async def _clear(node: Node, name: str, state: SystemState) -> None:
    try:
        if await node.unregister_dead(name, state):
            log.info("%s was killed: it is unregistered from the ROS master", name)
    except Ros1Error as error:
        log.warning("%s stays registered at the ROS master: %s", name, error)
