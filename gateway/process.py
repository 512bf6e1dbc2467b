"""The gateway process: one ROS node, one place on the bus, and the streams between them, both ways."""

import asyncio
import logging
import re
import time
import uuid
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

from bus import Bus, QoS, open_bus
from bus.clock import clock_id
from gateway.forward import Forward, offering
from gateway.outgoing.returned import actions_return, alerts_return, camera_returns
from gateway.outgoing.returning import Return
from gateway.outgoing.stream import StreamReturn
from gateway.outgoing.topics import result_root
from gateway.requests.answering import answering
from gateway.ros1.node import Node
from gateway.ros1.sim_clock import SimClock
from gateway.settings import GatewaySettings
from gateway.shaping.consumers import Consumers, stays_near
from gateway.shaping.shaping import Shaping
from gateway.sim_time import follow_sim_time
from gateway.stream import StreamForward
from gateway.translators import kind_of
from schemas import codec, keys
from schemas.keys import CameraKey
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
    shaping = Shaping(settings, Consumers(settings.robot, clock_id(), near=stays_near(settings)))
    log.info("robot %s: ROS master %s", settings.robot, settings.ros_master)
    for key, topic in settings.streams().items():
        log.info("%s: %s", key, topic)
    async with (
        open_bus(settings) as bus,
        _node(settings, boot_id) as node,
        AsyncExitStack() as stack,
        asyncio.TaskGroup() as group,
    ):
        streams = [
            StreamForward(key, topic, kind_of(key), boot_id, shaping.thinning(key))
            for key, topic in settings.streams().items()
        ]
        forwards = [await stack.enter_async_context(offering(bus, stream, shaping.outlet)) for stream in streams]
        returns = [Return(stream) for stream in _returned(settings)]
        clock = SimClock()
        await stack.enter_async_context(answering(bus, node, settings, boot_id, clock))
        await stack.enter_async_context(bus.announce(keys.robot_alive(settings.robot)))
        tasks = [group.create_task(forward.run(node)) for forward in forwards]
        tasks += [group.create_task(returned.run(node, bus)) for returned in returns]
        tasks.append(group.create_task(follow_sim_time(node, clock)))
        report = _report(bus, node, settings, boot_id, clock, forwards=forwards, returns=returns)
        tasks.append(group.create_task(report))
        tasks.append(group.create_task(shaping.run(bus)))
        await node.shutdown_requested.wait()
        for task in tasks:
            task.cancel()
    return SHUT_DOWN_BY_MASTER


@asynccontextmanager
async def _node(settings: GatewaySettings, boot_id: str) -> AsyncIterator[Node]:
    name = settings.names(node_name(settings.robot, boot_id)).node
    async with AsyncExitStack() as stack:
        try:
            node = await stack.enter_async_context(Node(name, master_uri=settings.ros_master, host=settings.ros_host))
        except OSError as error:
            raise HostError(f"--ros-host {settings.ros_host}: cannot listen there: {error}") from error
        yield node


def node_name(robot: str, boot_id: str) -> str:
    """Return a ROS node name that is the robot's and this process's alone: a master ends the older of two namesakes."""
    return f"fleetsight_gateway_{re.sub('[^A-Za-z0-9_]', '_', robot)}_{boot_id[:8]}"


def _returned(settings: GatewaySettings) -> list[StreamReturn[Any]]:
    resolve = settings.names().resolve
    actions = actions_return(settings.robot, settings.actions, resolve)
    if not settings.results:
        return [actions]
    cameras = [
        returned
        for place, camera in enumerate(settings.cameras)
        for returned in camera_returns(CameraKey(settings.robot, camera), result_root(camera, first=not place), resolve)
    ]
    return [*cameras, alerts_return(settings.robot, resolve), actions]


async def _report(
    bus: Bus,
    node: Node,
    settings: GatewaySettings,
    boot_id: str,
    sim_clock: SimClock,
    *,
    forwards: Sequence[Forward],
    returns: Sequence[Return[Any]],
) -> None:
    clock = clock_id()

    def account() -> bytes:
        missing = "" if node.master_answers is not False else f"the ROS master at {settings.ros_master}"
        status = GatewayStatus(
            robot=settings.robot,
            boot_id=boot_id,
            clock_id=clock,
            sent_ns=time.time_ns(),
            waiting_for=missing,
            ros_time_ns=sim_clock.ros_time_ns,
            clock_jumps=sim_clock.jumps,
            streams=[forward.status() for forward in forwards],
            returns=[returned.status() for returned in returns],
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
