"""The gateway process: one ROS node, one place on the bus, and the streams between them."""

import asyncio
import logging
import os
import re
import time
import uuid
from collections.abc import Sequence
from contextlib import AsyncExitStack

from bus import Bus, QoS, open_bus
from bus.clock import clock_id
from gateway.forward import Forward, offering
from gateway.ros1.node import Node
from gateway.settings import GatewaySettings
from gateway.stream import StreamForward
from gateway.translators import kind_of
from schemas import codec, keys
from schemas.status import GatewayStatus

log = logging.getLogger(__name__)

STATUS_PERIOD_S = 1.0


async def run(settings: GatewaySettings) -> None:
    """Forward the robot's sensors until cancelled, or until the ROS master tells the node to shut down."""
    boot_id = uuid.uuid4().hex
    log.info("robot %s: ROS master %s", settings.robot, settings.ros_master)
    for key, topic in settings.streams().items():
        log.info("%s: %s", key, topic)
    async with (
        open_bus(settings) as bus,
        Node(node_name(settings.robot), master_uri=settings.ros_master, host=settings.ros_host) as node,
        AsyncExitStack() as stack,
        asyncio.TaskGroup() as group,
    ):
        streams = [StreamForward(key, topic, kind_of(key), boot_id) for key, topic in settings.streams().items()]
        forwards = [await stack.enter_async_context(offering(bus, stream)) for stream in streams]
        await stack.enter_async_context(bus.announce(keys.robot_alive(settings.robot)))
        tasks = [group.create_task(forward.run(node)) for forward in forwards]
        tasks.append(group.create_task(_report(bus, node, settings, boot_id, forwards)))
        await node.shutdown_requested.wait()
        for task in tasks:
            task.cancel()


def node_name(robot: str) -> str:
    """Return a ROS node name that is the robot's and this process's alone: a master ends the older of two namesakes."""
    return f"/fleetsight_gateway_{re.sub('[^A-Za-z0-9_]', '_', robot)}_{os.getpid()}"


async def _report(bus: Bus, node: Node, settings: GatewaySettings, boot_id: str, forwards: Sequence[Forward]) -> None:
    clock = clock_id()

    def account() -> bytes:
        missing = "" if node.master_answers is not False else f"the ROS master at {settings.ros_master}"
        status = GatewayStatus(
            robot=settings.robot,
            boot_id=boot_id,
            clock_id=clock,
            sent_ns=time.time_ns(),
            waiting_for=missing,
            streams=[forward.status() for forward in forwards],
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
