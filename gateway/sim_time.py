"""Follows `/clock` while the robot's ROS graph uses simulated time."""

import asyncio
import logging
from typing import Final

from bus.demand import SharedDemand, while_wanted
from gateway.ros1.errors import MessageError, Ros1Error
from gateway.ros1.node import Node
from gateway.ros1.sim_clock import PARAMETER, TOPIC, TYPE_NAME, SimClock, decode_clock
from gateway.ros1.tcpros.subscriber import Message

log = logging.getLogger(__name__)

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
