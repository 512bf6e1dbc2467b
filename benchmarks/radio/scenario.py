"""A simulated robot's gateway behind a radio link, a worker, and a subscriber to its class lists."""

import asyncio
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass
from tempfile import NamedTemporaryFile
from typing import Final

from benchmarks.gateway.flow import free_endpoint
from benchmarks.gateway.processes import START_S, PeerError, module, running
from benchmarks.progress import note
from benchmarks.radio.relay import Relay
from benchmarks.scaling.observer import Observer, observing
from benchmarks.scaling.results import Log
from bus.settings import port_of
from services.toolbox.demo.children import child, free_ports

ROBOT: Final = "r1"
HZ: Final = 5.0
FRAMES: Final = 40
SEED: Final = 0
FRAME_MS: Final = 20.0
ELSEWHERE: Final = "elsewhere"
"""The worker's boot id: it counts as on another machine, as images stay raw on one and no budget holds for them."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where all of it is. master: the robot's."""

    observer: Observer
    relay: Relay
    master: str

    @asynccontextmanager
    async def gateway(self, *options: str) -> AsyncIterator[None]:
        """Run the robot's gateway, as it runs on a robot, until the context is left; class lists come by then."""
        command = ["gateway", "--robot", ROBOT, "--ros-master", self.master, "--ros-host", "127.0.0.1"]
        command += ["--connect", self.relay.endpoint, "--listen", free_endpoint()]
        command += ["--no-shared-memory", "--no-results", *options]
        began_s = time.time()
        async with child("gateway", command, note):
            await self.first_after(began_s)
            yield

    async def first_after(self, since_s: float) -> float:
        """Return when the first class list of a frame that the gateway had after a time came.

        Raises:
            PeerError: none came.
        """
        deadline = time.monotonic() + START_S
        while (first := self.log(since_s).first_of_frame_after(since_s)) is None:
            if time.monotonic() > deadline:
                raise PeerError(f"no class list came within {START_S:g} s")
            await asyncio.sleep(0.02)
        return first

    def log(self, since_s: float) -> Log:
        """Return what came since."""
        return self.observer.log().between(since_s, float("inf"))


@asynccontextmanager
async def place(mbit: float) -> AsyncIterator[Place]:
    """Start everything but the gateway, behind a link of so many megabits a second."""
    router, master_port = free_endpoint(), free_ports(1)
    robot: Sequence[str] = ["simulate", "--prerender", "--streams", "color", "--hz", str(HZ), "--frames", str(FRAMES)]
    robot = [*robot, "--seed", str(SEED), "--master-port", str(master_port)]
    with NamedTemporaryFile("w+") as boot_id, ExitStack() as stack:
        boot_id.write(ELSEWHERE)
        boot_id.flush()
        stack.enter_context(running(module("router", router))).ask()
        observer = stack.enter_context(observing(router))
        stack.enter_context(running(module("stand_in_worker", router, "w1", str(FRAME_MS), boot_id.name)))
        async with Relay(int(port_of(router)), mbit) as relay, child("simulator", robot, note):
            yield Place(observer, relay, f"http://127.0.0.1:{master_port}")
