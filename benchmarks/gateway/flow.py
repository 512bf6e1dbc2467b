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
from bus.config import session_config
from services.toolbox.demo.ports import free_ports

Variant = Literal["fleetsight", "rospy_naive", "zenoh_only"]
VARIANTS: Final[tuple[Variant, ...]] = ("fleetsight", "rospy_naive", "zenoh_only")

TOPIC: Final = "/camera/color/image_raw"
KEY: Final = "fleet/r1/camera/color"
NAIVE: Final = Path(__file__).parents[1] / "peers" / "rospy_gateway.py"
STALLED_LEASE_S: Final = 60
WARM_UP_S: Final = 1.5
MS: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Figure:
    """Distinct frames that the subscriber had per second, and milliseconds: cpu_* of processor time per such frame.

    cpu_ms: of the process that puts them on Zenoh. cpu_camera_ms, cpu_subscriber_ms: of its neighbours.
    age_ms: median time from the making of a frame to the subscriber. age_in_gateway_ms: since the gateway had it.
    """

    frames_per_s: float
    cpu_ms: float
    cpu_camera_ms: float
    cpu_subscriber_ms: float
    age_ms: float
    age_in_gateway_ms: float | None


def measure(variant: Variant, master: str, *, hz: float, seconds: float, shared_memory: bool) -> Figure:
    """Run a variant at `hz` frames a second, or flat out if that is 0, with processes of its own."""
    with ExitStack() as stack:
        endpoint = free_endpoint()
        subscriber = stack.enter_context(subscribing(KEY, endpoint, master, shared_memory=shared_memory))
        config = zenoh_config([endpoint], shared_memory=shared_memory)
        sender = stack.enter_context(running(_command(variant, endpoint, config, hz, master, shared_memory=shared_memory), master))
        camera = sender if variant == "zenoh_only" else stack.enter_context(running(module("camera", str(hz), TOPIC), master))
        await_frames(subscriber, [sender, camera])
        time.sleep(WARM_UP_S)
        return _figure(sender, camera, subscriber, seconds)


def _figure(sender: Process, camera: Process, subscriber: Process, seconds: float) -> Figure:
    processes = (sender, camera, subscriber)
    before, cpu_before, began = subscriber.ask(), [process.cpu_s() for process in processes], time.perf_counter()
    time.sleep(seconds)
    after, cpu, elapsed = subscriber.ask(), [process.cpu_s() for process in processes], time.perf_counter() - began
    frames = after["frames"] - before["frames"]
    spent = [(now - then) * 1000 / frames for now, then in zip(cpu, cpu_before, strict=True)]
    in_gateway = after["age_in_gateway_ns"]
    return Figure(
        frames / elapsed,
        *spent,
        age_ms=statistics.median(after["age_ns"]) * MS,
        age_in_gateway_ms=statistics.median(in_gateway) * MS if in_gateway else None,
    )


def _command(
    variant: Variant, endpoint: str, config: str, hz: float, master: str, *, shared_memory: bool
) -> list[str]:
    match variant:
        case "fleetsight":
            return gateway([endpoint], master, shared_memory=shared_memory)
        case "rospy_naive":
            return [ROS_PYTHON, str(NAIVE), config, KEY]
        case "zenoh_only":
            return module("zenoh_publisher", config, KEY, str(hz))


def gateway(endpoints: list[str], master: str, *options: str, shared_memory: bool) -> list[str]:
    """Return the command line of fleetsight's gateway."""
    memory = "--shared-memory" if shared_memory else "--no-shared-memory"
    place = ["--robot", "r1", "--ros-master", master, "--ros-host", "127.0.0.1", "--mode", "peer"]
    connect = ["--connect", ",".join(endpoints)]
    return [sys.executable, "-m", "services.toolbox", "gateway", *place, memory, *connect, *options]


@contextmanager
def subscribing(key: str, endpoint: str, master: str, *, shared_memory: bool, lease_s: float = 2.0) -> Iterator[Process]:
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
