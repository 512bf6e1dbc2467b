"""What the gateway costs while nobody listens."""

import time
from contextlib import ExitStack
from typing import Final

from benchmarks.gateway.flow import free_endpoint, gateway, subscribing
from benchmarks.gateway.link_meter import LinkMeter
from benchmarks.gateway.processes import module, running
from benchmarks.peers.frames import SIZE

CAMERAS: Final = 10
SETTLE_S: Final = 5.0


def measure(master: str, seconds: float) -> dict[str, float]:
    """Advertise 20 topics, colour and depth of CAMERAS cameras, to a gateway that has a Zenoh peer without wishes."""
    colour = {f"c{number}": f"/c{number}/color/image_raw" for number in range(CAMERAS)}
    depth = {f"c{number}/depth": f"/c{number}/depth/image_raw" for number in range(CAMERAS)}
    mapping = ["--cameras", _pairs(colour), "--topics", _pairs(depth)]
    with ExitStack() as stack:
        endpoint = free_endpoint()
        stack.enter_context(subscribing("nothing/of/the/fleet", endpoint, master, shared_memory=False))
        meter = stack.enter_context(LinkMeter(int(endpoint.rpartition(":")[2])))
        topics = [*colour.values(), *depth.values()]
        camera = stack.enter_context(running(module("camera", "30", *topics), master))
        command = gateway([meter.endpoint], master, *mapping, shared_memory=False)
        process = stack.enter_context(running(command, master))
        time.sleep(SETTLE_S)
        cpu, sent, crossed, began = process.cpu_s(), _sent(camera.ask()), meter.payload_bytes, time.monotonic()
        time.sleep(seconds)
        spent, elapsed = process.cpu_s() - cpu, time.monotonic() - began
        idle_bytes = meter.payload_bytes - crossed + (_sent(camera.ask()) - sent) * SIZE
    return {"idle_cpu_percent": round(100 * spent / elapsed, 2), "idle_bytes": idle_bytes}


def _pairs(named: dict[str, str]) -> str:
    return ",".join(f"{name}={topic}" for name, topic in named.items())


def _sent(counts: dict[str, int]) -> int:
    return sum(counts.values())
