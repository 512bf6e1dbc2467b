"""The gateway process: one ROS node, one place on the bus, and the streams between them, both ways."""

import asyncio
import logging
import time
import uuid
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

from bus import Bus, QoS, open_bus
from bus.clock import clock_id
from gateway.exploring import Explorer
from gateway.nodes import node_name
from gateway.offers import Offers
from gateway.ros1.node import Node
from gateway.ros1.tasks import cancel_and_wait
from gateway.settings import GatewaySettings
from schemas import codec, keys
from schemas.status import GatewayStatus

log = logging.getLogger(__name__)

STATUS_PERIOD_S = 1.0
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
    boot_id = uuid.uuid4().hex
    log.info("robot %s: ROS master %s", settings.robot, settings.ros_master)
    async with open_bus(settings) as bus, _node(settings, boot_id) as node, asyncio.TaskGroup() as group:
        offers = Offers(group, bus, node, boot_id=boot_id, results=settings.results)
        explorer = Explorer(node, settings.wishes())
        await explorer.begin(offers)
        async with bus.announce(keys.robot_alive(settings.robot)):
            exploring = group.create_task(explorer.run(offers))
            reporting = group.create_task(_report(bus, node, settings, boot_id, offers=offers, explorer=explorer))
            await node.shutdown_requested.wait()
            await cancel_and_wait({exploring, reporting})
        await offers.close()
    return SHUT_DOWN_BY_MASTER


@asynccontextmanager
async def _node(settings: GatewaySettings, boot_id: str) -> AsyncIterator[Node]:
    name = node_name(settings.robot, boot_id)
    async with AsyncExitStack() as stack:
        try:
            node = await stack.enter_async_context(Node(name, master_uri=settings.ros_master, host=settings.ros_host))
        except OSError as error:
            raise HostError(f"--ros-host {settings.ros_host}: cannot listen there: {error}") from error
        yield node


async def _report(
    bus: Bus,
    node: Node,
    settings: GatewaySettings,
    boot_id: str,
    *,
    offers: Offers,
    explorer: Explorer,
) -> None:
    clock = clock_id()

    def account() -> bytes:
        master = "" if node.master_answers is not False else f"the ROS master at {settings.ros_master}"
        status = GatewayStatus(
            robot=settings.robot,
            boot_id=boot_id,
            clock_id=clock,
            sent_ns=time.time_ns(),
            waiting_for=master or explorer.waiting_for,
            streams=offers.streams(),
            returns=offers.returns(),
            withdrawn=dict(offers.withdrawn()),
        )
        return codec.encode(status)

    key = keys.gateway_status(settings.robot)
    async with bus.publisher(key, QoS.STATUS, encoding=codec.encoding(GatewayStatus)) as publisher:
        try:
            while True:
                publisher.put(account())
                await asyncio.sleep(STATUS_PERIOD_S)
        finally:
            publisher.put(account())
