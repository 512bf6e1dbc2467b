"""Gateways that were killed stay registered at the ROS master: the next one of their robot clears them away."""

import logging
from contextlib import aclosing

from gateway.nodes import is_of
from gateway.ros1.errors import Ros1Error
from gateway.ros1.master import SystemState
from gateway.ros1.node import Node

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
            log.info("%s is no more: it was killed and is unregistered now", name)
    except Ros1Error as error:
        log.warning("%s stays registered at the ROS master: %s", name, error)
