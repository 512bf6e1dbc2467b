"""What a simulated fleet costs once it is rendered, with colour and depth of every robot subscribed to.

The simulator runs as its users start it, pre-rendered; the subscribers are here. cpu_share is the simulator's
processor time over the time by the clock: 1 is a whole core. hz_least is what the worst served subscriber got.
"""

import asyncio
import time
from collections import Counter
from contextlib import AsyncExitStack
from functools import partial
from typing import Any, Final

import psutil

from benchmarks.arguments import parser_of, show
from benchmarks.machine import machine, versions
from benchmarks.progress import note
from benchmarks.targets import at_least, at_most
from gateway.ros1.image import TYPE_NAME
from gateway.ros1.node import Node
from gateway.ros1.tcpros.subscriber import Message
from services.toolbox.demo.children import child, free_ports

TOPICS: Final = ("/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw")
STREAMS: Final = "color,depth"
KEPT_UP: Final = 0.98
"""The share of its rate that the worst served subscriber is to get: else the fleet limits whoever tries it."""

CPU_SHARE: Final = 0.5
"""Of a core: what is left is the demo's."""

SEEDS: Final = range(1, 4)
"""Of the warehouses, which the robots share."""


def main() -> None:
    """Measure and print."""
    parser = parser_of("benchmarks.simulated_fleet", __doc__)
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--hz", type=float, default=2.0)
    parser.add_argument("--seconds", type=float, default=20.0, help="how long to measure (default: 20)")
    parser.add_argument("--frames", type=int, default=40, help="instants of a loop; rendered first (default: 40)")
    arguments = parser.parse_args()
    found = asyncio.run(run(arguments.robots, arguments.hz, arguments.seconds, arguments.frames))
    show(found, as_json=arguments.json)


async def run(robots: int, hz: float, seconds: float, frames: int) -> dict[str, Any]:
    """Start the fleet, subscribe to all of it, and measure once everybody has got something."""
    port = free_ports(robots)
    options = ["--robots", str(robots), "--hz", str(hz), "--frames", str(frames), "--master-port", str(port)]
    options += ["--seed", str(SEEDS[0] - 1), "--warehouses", str(len(SEEDS))]
    received: Counter[tuple[int, str]] = Counter()
    async with AsyncExitStack() as stack:
        command = ["simulate", "--prerender", "--streams", STREAMS, *options]
        fleet = await stack.enter_async_context(child("simulator", command, note))
        for number in range(robots):
            node = Node(f"/subscriber_{number}", master_uri=f"http://127.0.0.1:{port + number}")
            await stack.enter_async_context(node)
            for topic in TOPICS:
                count = partial(_count, received, (number, topic))
                await stack.enter_async_context(node.subscribe(topic, TYPE_NAME, count))
        while len(received) < robots * len(TOPICS):  # noqa: ASYNC110 - another process
            await asyncio.sleep(0.1)
        measured = await _measured(psutil.Process(fleet.process.pid), received, seconds)
    settings = {"robots": robots, "hz": hz, "streams": STREAMS, "frames": frames, "image": "640x480"}
    about = {"machine": machine(), "versions": versions(["numpy"]), "seeds": list(SEEDS)}
    targets = {**at_least(measured, "hz_least", KEPT_UP * hz), **at_most(measured, "cpu_share", CPU_SHARE)}
    return {"targets": targets, **measured, **settings, **about}


async def _measured(process: psutil.Process, received: Counter[tuple[int, str]], seconds: float) -> dict[str, Any]:
    before, began = received.copy(), time.monotonic()
    cpu = sum(process.cpu_times()[:2])
    await asyncio.sleep(seconds)
    elapsed = time.monotonic() - began
    rates = [(received[key] - before[key]) / elapsed for key in received]
    return {
        "cpu_share": round((sum(process.cpu_times()[:2]) - cpu) / elapsed, 3),
        "hz_least": round(min(rates), 2),
        "hz_mean": round(sum(rates) / len(rates), 2),
        "memory_mb": round(process.memory_info().rss / 1e6),
        "load_average": round(psutil.getloadavg()[0], 1),
    }


def _count(received: Counter[tuple[int, str]], key: tuple[int, str], _message: Message) -> None:
    received[key] += 1


if __name__ == "__main__":
    main()
