"""The gateway process: one ROS node, one place on the bus, and the streams between them, both ways."""

import asyncio
import logging
import uuid
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

from bus import open_bus
from bus.clocks import clock_id
from bus.reporting import report
from gateway.account import Account
from gateway.exploring import Explorer
from gateway.nodes import node_name
from gateway.offers import Offers
from gateway.outgoing.recorders import warn_of_recorders
from gateway.outgoing.returned import actions_return, alerts_return, camera_returns
from gateway.outgoing.returning import Return
from gateway.outgoing.stream import StreamReturn
from gateway.own_host import warn_of_own_host
from gateway.predecessors import clear_predecessors
from gateway.requests.answering import answering
from gateway.ros1.node import Node
from gateway.ros1.sim_clock import SimClock
from gateway.ros1.tasks import cancel_and_wait
from gateway.scheduling import giving_way
from gateway.settings import GatewaySettings
from gateway.shaping.consumers import Consumers, stays_near
from gateway.shaping.shaping import Shaping
from gateway.sim_time import follow_sim_time
from schemas import keys
from schemas.keys import CameraKey
from schemas.status import GatewayStatus

log = logging.getLogger(__name__)

SHUT_DOWN_BY_MASTER = 1


class HostError(Exception):
    """Other ROS nodes cannot reach this machine where the settings say."""


async def run(settings: GatewaySettings) -> int:
    """Forward the robot's sensors and return its cameras' results until cancelled.

    Returns:
        The exit code when the ROS master has told the node to shut down: not 0, so that a supervisor starts another.

    Raises:
        HostError: nothing can listen at `ros_host`.
        BusError: nothing can listen where the bus settings say.
    """
    with giving_way():
        return await _run(settings)


async def _run(settings: GatewaySettings) -> int:
    boot_id, machine = uuid.uuid4().hex, clock_id()
    shaping = Shaping(settings, Consumers(settings.robot, machine, near=stays_near(settings)))
    clock = SimClock()
    log.info("robot %s: ROS master %s", settings.robot, settings.ros_master)
    async with open_bus(settings) as bus, _node(settings, boot_id) as node, asyncio.TaskGroup() as group:
        offers = Offers(
            group,
            bus,
            node,
            boot_id=boot_id,
            shaping=shaping,
            returned=lambda camera, root: _camera_returns(settings, camera, root),
            max_message_bytes=settings.max_message_bytes,
        )
        explorer = Explorer(node, settings.wishes(), settings.unused)
        returns = [Return(stream) for stream in _robot_returns(settings)]
        account = Account(settings, boot_id, machine, node, clock, explorer, offers, returns)
        await explorer.begin(offers)
        async with answering(bus, node, settings, boot_id, clock), bus.announce(keys.robot_alive(settings.robot)):
            work = (
                warn_of_own_host(settings),
                clear_predecessors(node, settings.robot),
                warn_of_recorders(node, settings.is_passive),
                explorer.run(offers),
                shaping.run(bus),
                follow_sim_time(node, clock),
                report(bus, keys.gateway_status(settings.robot), GatewayStatus, account.status),
                *(returned.run(node, bus) for returned in returns),
            )
            tasks = {group.create_task(each) for each in work}
            await node.shutdown_requested.wait()
            await cancel_and_wait(tasks)
        await offers.close()
    return SHUT_DOWN_BY_MASTER


@asynccontextmanager
async def _node(settings: GatewaySettings, boot_id: str) -> AsyncIterator[Node]:
    name = settings.names(node_name(settings.robot, boot_id)).node
    async with AsyncExitStack() as stack:
        try:
            node = Node(name, master_uri=settings.ros_master, host=settings.ros_host, passive=settings.is_passive)
            await stack.enter_async_context(node)
        except OSError as error:
            raise HostError(f"{settings.host_given_by()} {settings.ros_host}: cannot listen there: {error}") from error
        yield node


def _camera_returns(settings: GatewaySettings, camera: CameraKey, root: str) -> list[StreamReturn[Any]]:
    return camera_returns(camera, root, settings.names().resolve) if settings.results else []


def _robot_returns(settings: GatewaySettings) -> list[StreamReturn[Any]]:
    resolve = settings.names().resolve
    alerts = [alerts_return(settings.robot, resolve)] if settings.results else []
    return [*alerts, actions_return(settings.robot, settings.actions, resolve)]
