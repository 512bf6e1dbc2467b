"""What a gateway answers for as long as it runs."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from bus import Bus
from gateway.requests.clock import clock_handler
from gateway.requests.services import ServiceCalls
from gateway.ros1.node import Node
from gateway.ros1.service_client import ServiceClient
from gateway.ros1.sim_clock import SimClock
from gateway.settings import GatewaySettings
from schemas import keys


@asynccontextmanager
async def answering(
    bus: Bus, node: Node, settings: GatewaySettings, boot_id: str, clock: SimClock
) -> AsyncIterator[None]:
    """Answer requests for the robot's clock and for its services while the context lasts."""
    client = ServiceClient(node.master, callerid=node.name)
    calls = ServiceCalls(settings.robot, settings.listed_services(), client)
    async with (
        bus.serve(
            keys.robot_clock(settings.robot),
            clock_handler(settings.robot, boot_id, lambda: clock.ros_time_ns),
            waiting=64,
        ),
        bus.serve(keys.every_service(settings.robot), calls, at_once=calls.at_once, waiting=0),
    ):
        yield
