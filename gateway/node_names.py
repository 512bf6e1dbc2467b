"""Node names of gateways on a ROS graph, and clean-up after killed gateways."""

import logging
import re
from contextlib import aclosing
from typing import Final

from gateway.ros1.errors import Ros1Error
from gateway.ros1.master import SystemState
from gateway.ros1.node import Node

PREFIX: Final = "fleetsight_gateway_"


def ros_chunk(name: str) -> str:
    """Return a robot's or camera's name as a legal chunk of a ROS name; several names may give one chunk."""
    return re.sub("[^A-Za-z0-9_]", "_", name)


def node_name(robot: str, boot_id: str) -> str:
    """Return a unique ROS node name: a master shuts down the older of two nodes with one name."""
    return f"{PREFIX}{ros_chunk(robot)}_{boot_id[:8]}"


def is_of(node: str, robot: str) -> bool:
    """Return whether a node's global name is one that `node_name` gives the robot's gateways."""
    return (
        re.fullmatch(f"{PREFIX}{ros_chunk(robot)}_[0-9a-f]{{8}}(_[0-9]{{1,5}})?", node.rpartition("/")[2]) is not None
    )


def is_gateway(node: str) -> bool:
    """Return whether a node's global name is a gateway's, of any robot."""
    return node.rpartition("/")[2].startswith(PREFIX)


log = logging.getLogger(__name__)


async def clear_predecessors(node: Node, robot: str) -> None:
    """Once the master answers, unregister the robot's dead gateways, except those with a configured name."""
    async with aclosing(node.looks()) as looks:
        look = await anext(looks)
    for name in sorted(look.state.nodes() - {look.node}):
        if is_of(name, robot):
            await _clear(node, name, look.state)


async def _clear(node: Node, name: str, state: SystemState) -> None:
    try:
        if await node.unregister_dead(name, state):
            log.info("%s was killed: it is unregistered from the ROS master", name)
    except Ros1Error as error:
        log.warning("%s stays registered at the ROS master: %s", name, error)
