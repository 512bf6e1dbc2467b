"""One camera through one gateway to one subscriber: rates, processor time and latency."""

import json
import statistics
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from benchmarks.gateway.processes import ROS_PYTHON, START_S, PeerError, Process, module, running
from bus import BusSettings
from bus.session.config import session_config
from services.toolbox.demo.children import free_ports

Variant = Literal["fleetsight", "rospy_naive", "bare_gateway", "zenoh_only", "tcpros_only"]
"""tcpros_only: a subscriber on ROS's side that throws everything away, in the place of gateway and subscriber."""

TOPIC: Final = "/camera/color/image_raw"
KEY: Final = "fleet/r1/camera/color"
NAIVE: Final = Path(__file__).parents[1] / "peers" / "rospy_gateway.py"
WARM_UP_S: Final = 1.5
MS: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Figure:
    """Distinct frames that the subscriber had per second, and milliseconds of processor time per such frame.

    cpu_ms_per_frame: of the process that is measured; the others' are its neighbours', its own where it has none.
    latency_p50_ms: from the making of a frame to the subscriber; gateway_latency_p50_ms: since the gateway had it.
    """

    frames_per_s: float
    cpu_ms_per_frame: float
    camera_cpu_ms_per_frame: float
    subscriber_cpu_ms_per_frame: float
    latency_p50_ms: float
    gateway_latency_p50_ms: float | None


def measure(variant: Variant, master: str, *, hz: float, seconds: float, shared_memory: bool) -> Figure:
    """Run a variant at `hz` frames a second, or flat out if that is 0, with processes of its own."""
    endpoint = free_endpoint()
    config = zenoh_config([endpoint], shared_memory=shared_memory)
    with ExitStack() as stack:

        def run(command: list[str]) -> Process:
            return stack.enter_context(running(command, master))

        if variant == "tcpros_only":
            camera = run(module("camera", str(hz), TOPIC))
            measured = subscriber = run(module("tcpros_subscriber", TOPIC))
        else:
            subscriber = stack.enter_context(subscribing(KEY, endpoint, master, shared_memory=shared_memory))
            measured = run(_command(variant, endpoint, config, hz, master, shared_memory=shared_memory))
            camera = measured if variant == "zenoh_only" else run(module("camera", str(hz), TOPIC))
        await_frames(subscriber, [measured, camera])
        time.sleep(WARM_UP_S)
        return _figure(measured, camera, subscriber, seconds)


def _figure(sender: Process, camera: Process, subscriber: Process, seconds: float) -> Figure:
    processes = (sender, camera, subscriber)
    before, cpu_before, began = subscriber.ask(), [process.cpu_s() for process in processes], time.perf_counter()
    time.sleep(seconds)
    after, cpu, elapsed = subscriber.ask(), [process.cpu_s() for process in processes], time.perf_counter() - began
    frames = after["frames"] - before["frames"]
    spent = [(now - then) * 1000 / frames for now, then in zip(cpu, cpu_before, strict=True)]
    own, neighbour_camera, neighbour_subscriber = spent
    in_gateway = after["age_in_gateway_ns"]
    return Figure(
        frames_per_s=frames / elapsed,
        cpu_ms_per_frame=own,
        camera_cpu_ms_per_frame=neighbour_camera,
        subscriber_cpu_ms_per_frame=neighbour_subscriber,
        latency_p50_ms=statistics.median(after["age_ns"]) * MS,
        gateway_latency_p50_ms=statistics.median(in_gateway) * MS if in_gateway else None,
    )


def _command(
    variant: Literal["fleetsight", "rospy_naive", "bare_gateway", "zenoh_only"],
    endpoint: str,
    config: str,
    hz: float,
    master: str,
    *,
    shared_memory: bool,
) -> list[str]:
    match variant:
        case "fleetsight":
            return gateway([endpoint], master, shared_memory=shared_memory)
        case "rospy_naive":
            return [ROS_PYTHON, str(NAIVE), config, KEY]
        case "bare_gateway":
            return module("bare_gateway", config, KEY, TOPIC)
        case "zenoh_only":
            return module("zenoh_publisher", config, KEY, str(hz))


def gateway(endpoints: list[str], master: str, *options: str, shared_memory: bool) -> list[str]:
    """Return the command line of fleetsight's gateway."""
    memory = "--shared-memory" if shared_memory else "--no-shared-memory"
    place = ["--robot", "r1", "--ros-master", master, "--ros-host", "127.0.0.1", "--mode", "peer"]
    connect = ["--connect", ",".join(endpoints), "--compression", "raw"]
    return [sys.executable, "-m", "services.toolbox", "gateway", *place, memory, *connect, *options]


@contextmanager
def subscribing(
    key: str, endpoint: str, master: str, *, shared_memory: bool, lease_s: float = 2.0
) -> Iterator[Process]:
    """Run a subscriber that listens at an endpoint for its one peer."""
    settings = BusSettings(mode="peer", listen=[endpoint], connect=[], shared_memory=shared_memory, lease_s=lease_s)
    with running(module("zenoh_subscriber", json.dumps(session_config(settings)), key), master) as subscriber:
        subscriber.ask()
        yield subscriber


def zenoh_config(connect: list[str], *, shared_memory: bool) -> str:
    """Return the transport settings of a process that opens its own Zenoh session, the same as the gateway's."""
    return json.dumps(session_config(BusSettings(mode="peer", connect=connect, shared_memory=shared_memory)))


def free_endpoint() -> str:
    """Return a place to listen at."""
    return f"tcp/127.0.0.1:{free_ports(1)}"


def await_frames(subscriber: Process, processes: list[Process]) -> None:
    """Wait for a first frame.

    Raises:
        PeerError: none came; says what the processes said.
    """
    deadline = time.monotonic() + START_S
    while not subscriber.ask()["frames"]:
        if time.monotonic() > deadline:
            raise PeerError("\n".join(process.last_words() for process in processes))
        time.sleep(0.05)
