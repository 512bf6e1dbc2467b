"""The fleet as its users run it: real processes around a router that the test embeds."""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Final, TypeVar

from bus import QUEUE, Bus, BusSettings, Subscription, open_bus
from schemas import codec, keys
from schemas.codec import M
from schemas.status import GatewayStatus, ReturnStatus, StreamStatus
from services.toolbox.demo.children import Child, child, free_ports

PATIENCE_S: Final = 60

A = TypeVar("A")

log = logging.getLogger(__name__)


class FleetRig:
    """A router at `endpoint`, and `fleetsight` processes that connect to it."""

    def __init__(self, bus: Bus, endpoint: str, stack: AsyncExitStack) -> None:
        self.bus = bus
        self.endpoint = endpoint
        self._stack = stack

    def at(self, port: int) -> "FleetRig":
        """Return the same rig for processes that connect to another port, behind which the router is."""
        return FleetRig(self.bus, f"tcp/127.0.0.1:{port}", self._stack)

    async def start(self, command: str, *options: str) -> Child:
        """Start `fleetsight COMMAND OPTIONS` until the rig is taken down."""
        arguments = [command, "--connect", self.endpoint, *options]
        return await self._stack.enter_async_context(child(command, arguments, log.info))

    async def gateway(self, robot: str, master: str, cameras: Mapping[str, str], *options: str) -> Child:
        """Start a robot's gateway; with no cameras it finds what there is."""
        names = [option for camera, topic in cameras.items() for option in ("--cameras", f"{camera}={topic}")]
        where = ("--robot", robot, "--ros-master", master, "--ros-host", "127.0.0.1")
        return await self.start("gateway", *where, *names, *options)

    @asynccontextmanager
    async def subscribed(self, key_expr: str) -> AsyncIterator[Subscription]:
        """Subscribe as any other program of the fleet would."""
        async with self.bus.subscribe(key_expr, QUEUE(1000)) as subscription:
            yield subscription

    async def stream_status(
        self, robot: str, camera: str, until: Callable[[StreamStatus], bool] = lambda _: True
    ) -> StreamStatus:
        """Wait until the gateway's account of the camera is such; return it."""
        return await self._account(robot, lambda status: status.streams, lambda of: of.camera == camera and until(of))

    async def stream_topics(self, robot: str, until: Callable[[Mapping[str, str]], bool]) -> Mapping[str, str]:
        """Wait until the topics that the gateway offers are such; return them by stream."""
        async with self._statuses(robot) as statuses:
            async for status in statuses:
                topics = {f"{stream.camera}/{stream.stream}": stream.topic for stream in status.streams}
                if until(topics):
                    return topics
        raise AssertionError("the bus was closed")

    async def return_status(
        self, robot: str, camera: str, until: Callable[[ReturnStatus], bool] = lambda _: True, stream: str = "classes"
    ) -> ReturnStatus:
        """Wait until the gateway's account of a returned stream is such; return it."""
        return await self._account(
            robot,
            lambda status: status.returns,
            lambda of: (of.camera, of.stream) == (camera, stream) and until(of),
        )

    async def _account(
        self, robot: str, accounts: Callable[[GatewayStatus], Iterable[A]], until: Callable[[A], bool]
    ) -> A:
        """Wait until one of the accounts in the robot's status is such; return it."""
        async with self._statuses(robot) as statuses:
            async for status in statuses:
                for account in accounts(status):
                    if until(account):
                        return account
        raise AssertionError("the bus was closed")

    async def gateway_status(
        self, robot: str, until: Callable[[GatewayStatus], bool] = lambda _: True
    ) -> GatewayStatus:
        """Wait until the gateway's account of itself is such; return it."""
        async with self._statuses(robot) as statuses:
            async for status in statuses:
                if until(status):
                    return status
        raise AssertionError("the bus was closed")

    @asynccontextmanager
    async def _statuses(self, robot: str) -> AsyncIterator[AsyncIterator[GatewayStatus]]:
        async with asyncio.timeout(PATIENCE_S), self.subscribed(keys.gateway_status(robot)) as samples:
            yield (codec.decode(GatewayStatus, sample.payload, sample.encoding) async for sample in samples)


async def receive(subscription: Subscription, schema: type[M]) -> M:
    """Wait for the next message."""
    async with asyncio.timeout(PATIENCE_S):
        sample = await anext(subscription)
    return codec.decode(schema, sample.payload, sample.encoding)


@asynccontextmanager
async def fleet_rig() -> AsyncIterator[FleetRig]:
    """Embed a router, as the monitor does; what the rig started ends with it."""
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    async with AsyncExitStack() as stack:
        bus = await stack.enter_async_context(open_bus(BusSettings(mode="router", listen=[endpoint])))
        yield FleetRig(bus, endpoint, stack)
