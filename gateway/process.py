"""The gateway process: one ROS node, one bus connection, and the streams between them, both ways."""

import asyncio
import logging
import os
import time
import uuid
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import AsyncExitStack, aclosing, asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from bus import BusSettings, open_bus
from bus.clocks import clock_id
from bus.demand import SharedDemand, while_wanted
from bus.reporting import VERSION, report
from gateway.doctor.finding import Severity
from gateway.doctor.master import check_host
from gateway.doctor.reachability import look_at_host
from gateway.exploring import Explorer
from gateway.node_names import clear_predecessors, node_name
from gateway.offers import Offers
from gateway.requests import answering
from gateway.ros1.errors import MessageError, Ros1Error
from gateway.ros1.node import Node
from gateway.ros1.sim_clock import PARAMETER, TOPIC, TYPE_NAME, SimClock, decode_clock
from gateway.ros1.tasks import cancel_and_wait
from gateway.ros1.tcpros.subscriber import Message
from gateway.settings import GatewaySettings, RosSettings
from gateway.to_bus.shaping.consumers import Consumers, stays_near
from gateway.to_bus.shaping.shaping import Shaping
from gateway.to_ros.done_actions import DoneActions, state_folder
from gateway.to_ros.on_demand import Return
from gateway.to_ros.outputs import actions_return, alerts_return, camera_returns, cure, recorders, results_of
from gateway.to_ros.stream import StreamReturn
from gateway.to_ros.world import world_returns
from schemas import keys
from schemas.keys import CameraKey
from schemas.status import GatewayStatus


@dataclass(frozen=True, slots=True)
class GatewayCounters:
    """All counters in a gateway's status. returns: those of the whole robot."""

    settings: GatewaySettings
    boot_id: str
    clock_id: str
    node: Node
    clock: SimClock
    explorer: Explorer
    offers: Offers
    returns: Sequence[Return[Any]]

    def status(self) -> GatewayStatus:
        """Return the gateway's status."""
        return GatewayStatus(
            robot=self.settings.robot,
            boot_id=self.boot_id,
            clock_id=self.clock_id,
            sent_ns=time.time_ns(),
            waiting_for=self._waiting_for(),
            ros_time_ns=self.clock.ros_time_ns,
            clock_jumps=self.clock.jumps,
            streams=self.offers.streams(),
            returns=[*self.offers.returns(), *(returned.status() for returned in self.returns)],
            withdrawn=dict(self.offers.withdrawn()),
            version=VERSION,
        )

    def _waiting_for(self) -> str:
        if self.node.master_answers is False:
            return f"the ROS master at {self.settings.ros_master}"
        return self.explorer.waiting_for


@contextmanager
def giving_way() -> Iterator[None]:
    """Run this thread and its children under SCHED_BATCH, so that they preempt no program when they wake up.

    They wait for a processor that is idle, or until another program's turn is over, which takes milliseconds. That also
    keeps the threads of a gateway from interrupting each other: sending an image then takes fewer turns. A gateway
    started under another policy than the usual one keeps it.
    """
    gives_way = _changed(os.SCHED_OTHER, os.SCHED_BATCH)
    try:
        yield
    finally:
        if gives_way:
            _changed(os.SCHED_BATCH, os.SCHED_OTHER)


def _changed(before: int, after: int) -> bool:
    """Change this thread's policy if it is `before`; return whether it changed. Some sandboxes forbid it."""
    with suppress(OSError):
        if os.sched_getscheduler(0) == before:
            os.sched_setscheduler(0, after, os.sched_param(0))
            return True
    return False


LOOKUP_S: Final = 10.0
"""Longest time to look up the host's name."""

log = logging.getLogger(__name__)


async def warn_of_own_host(settings: RosSettings) -> None:
    """Log the doctor's problem with `ros_host`, if any, and the origin of the setting."""
    look = await look_at_host(settings.ros_host, LOOKUP_S)
    for finding in check_host(look, remote_master=False):
        if finding.severity is Severity.PROBLEM:
            log.warning("%s %s: %s; %s", settings.host_given_by(), finding.subject, finding.what, finding.advice)


async def warn_of_recorders(node: Node, passive: Callable[[str], bool]) -> None:
    """Log each node that subscribes to all results once, forever. passive: whether a node requests none."""
    said: set[str] = set()
    async with aclosing(node.looks()) as looks:
        async for look in looks:
            topics = results_of(look.node, look.state.publishers)
            found = recorders(topics, look.state.subscribers)
            for recorder in found:
                if recorder not in said:
                    _warn_of_recorder(recorder, len(topics), passive=passive(recorder))
            said = set(found)


def _warn_of_recorder(recorder: str, count: int, *, passive: bool) -> None:
    if passive:
        log.info("%s subscribes to all %d results; it is passive, so it makes none of them wanted", recorder, count)
        return
    log.warning(
        "%s subscribes to all %d results, as `rosbag record -a` does, so workers make all of them of every camera; %s",
        recorder,
        count,
        cure(recorder),
    )


POLL_S: Final = 3.0


async def follow_sim_time(node: Node, clock: SimClock, *, poll_s: float = POLL_S) -> None:
    """Update the clock from `/clock` while `/use_sim_time` is set at the master, forever."""
    demand = SharedDemand()
    async with asyncio.TaskGroup() as group:
        group.create_task(while_wanted(demand, lambda: _listen(node, clock)))
        tell = demand.of(PARAMETER)
        while True:
            tell(await _is_set(node, before=clock.used))
            await asyncio.sleep(poll_s)


async def _is_set(node: Node, *, before: bool) -> bool:
    try:
        return await node.master.uses_sim_time()
    except Ros1Error:  # the setting stays while the master is away
        return before


async def _listen(node: Node, clock: SimClock) -> None:
    def on_message(message: Message) -> None:
        try:
            jumped = clock.tell(decode_clock(message.data))
        except MessageError as error:
            log.warning("%s from %s: %s", TOPIC, message.callerid, error)
            return
        if jumped:
            log.warning("%s went back to %.3f s", TOPIC, clock.now_ns / 1e9)

    log.info("%s is set: ROS time is what %s says", PARAMETER, TOPIC)
    async with node.subscribe(TOPIC, TYPE_NAME, on_message):
        clock.used = True
        try:
            await asyncio.Event().wait()
        finally:
            clock.used = False
            clock.now_ns = 0


SHUT_DOWN_BY_MASTER = 1


class HostError(Exception):
    """Other ROS nodes cannot reach this machine at the host in the settings."""


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
    shaping = Shaping(settings, Consumers(settings.robot, machine, near=stays_near(settings), lease_s=settings.lease_s))
    clock = SimClock()
    log.info("robot %s: ROS master %s", settings.robot, settings.ros_master)
    async with (
        open_bus(_below_routers(settings), prefix=keys.robot_prefix(settings.robot)) as bus,
        _node(settings, boot_id) as node,
        asyncio.TaskGroup() as group,
    ):
        offers = Offers(
            group,
            bus,
            node,
            boot_id=boot_id,
            shaping=shaping,
            returned=lambda camera, root: _camera_returns(settings, camera, root),
            max_message_bytes=settings.max_message_bytes,
        )
        explorer = Explorer(node, settings.discovery_settings(), settings.unused)
        returns = [Return(stream) for stream in _robot_returns(settings, clock)]
        account = GatewayCounters(settings, boot_id, machine, node, clock, explorer, offers, returns)
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


def _below_routers(settings: GatewaySettings) -> BusSettings:
    """Return the bus settings of a client for a router that connects to one, which would hear of all other robots."""
    return (
        settings.model_copy(update={"mode": "client"}) if settings.mode == "router" and settings.connect else settings
    )


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


def _ros_time_ns(clock: SimClock) -> int:
    return time.time_ns() if (simulated := clock.ros_time_ns) is None else simulated


def _robot_returns(settings: GatewaySettings, clock: SimClock) -> list[StreamReturn[Any]]:
    resolve = settings.names().resolve
    results: list[StreamReturn[Any]] = []
    if settings.results:
        results.append(alerts_return(settings.robot, resolve))
        now = partial(_ros_time_ns, clock)
        results.extend(world_returns(settings.robot, resolve, own=settings.own_obstacles, ros_time_ns=now))
    before = DoneActions(state_folder(), settings.robot)
    return [*results, actions_return(settings.robot, settings.actions, resolve, before)]
