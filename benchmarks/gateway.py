"""The gateway against a rospy one and against Zenoh alone, in one run.

640x480 rgb8 images flat out, ROS 1 publisher and Zenoh subscriber in processes of their own. All three send over the
same kind of link, TCP on loopback between two Zenoh peers, with shared memory on and off. Needs Debian's ROS 1.
"""

import argparse
import asyncio
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import psutil
import zenoh

from benchmarks.machine import machine, versions
from bus import LATEST, BusSettings, open_bus
from bus.config import session_config
from services.toolbox.demo.ports import free_ports

PEERS: Final = Path(__file__).parent / "peers"
ROS_PYTHON: Final = "/usr/bin/python3"
ROSMASTER: Final = "/usr/bin/rosmaster"
WARM_UP_S: Final = 2.0
REPEATS: Final = 3
KEY: Final = "fleet/r1/camera/color"


@dataclass(frozen=True, slots=True)
class Figure:
    """Delivered frames per second, and milliseconds of processor time per delivered frame of the process measured."""

    frames_per_s: float
    cpu_ms_per_frame: float


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gateway", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--seconds", type=float, default=4.0, help="length of one measurement (default: 4)")
    arguments = parser.parse_args()
    if not Path(ROSMASTER).exists():
        parser.error("Debian's ROS 1 is not installed; tests/integration/install-ros.sh installs it")
    figures = asyncio.run(measure(arguments.seconds))
    print(json.dumps(figures) if arguments.json else "\n".join(f"{name}: {value}" for name, value in figures.items()))


async def measure(seconds: float) -> dict[str, object]:
    """Run every variant REPEATS times, in turn, and return the medians, their ratios and the spread."""
    runs: dict[str, list[Figure]] = {}
    with ros_master() as master:
        for repeat in range(REPEATS):
            for shared_memory in (True, False):
                for variant in ("fleetsight", "rospy_naive", "zenoh_only"):
                    name = variant if shared_memory else f"{variant}_no_shm"
                    note(f"[{repeat + 1}/{REPEATS}] {name}")
                    runs.setdefault(name, []).append(await run(variant, master, seconds, shared_memory=shared_memory))
    return report(runs)


def report(runs: Mapping[str, Sequence[Figure]]) -> dict[str, object]:
    """Name the medians as the targets name them."""
    figures: dict[str, object] = {}
    for name, found in runs.items():
        variant = name.removesuffix("_no_shm")
        prefix, ending = "" if variant == "fleetsight" else f"{variant}_", name.removeprefix(variant)
        rates = [figure.frames_per_s for figure in found]
        figures[f"{prefix}frames_per_s{ending}"] = round(statistics.median(rates), 1)
        figures[f"{prefix}frames_per_s{ending}_spread"] = [round(min(rates), 1), round(max(rates), 1)]
        if variant != "zenoh_only":
            cpu = statistics.median(figure.cpu_ms_per_frame for figure in found)
            figures[f"{prefix}cpu_ms_per_frame{ending}"] = round(cpu, 3)
    return {
        **figures,
        "frame": "640x480 rgb8",
        "repeats": REPEATS,
        "machine": machine(),
        "versions": versions(["eclipse-zenoh", "msgspec", "numpy"]),
    }


async def run(variant: str, master: str, seconds: float, *, shared_memory: bool) -> Figure:
    """Measure one variant with processes of its own."""
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    ours = BusSettings(mode="peer", listen=[endpoint], connect=[], shared_memory=shared_memory)
    theirs = BusSettings(mode="peer", connect=[endpoint], shared_memory=shared_memory)
    async with AsyncExitStack() as stack:
        bus = await stack.enter_async_context(open_bus(ours))
        subscription = await stack.enter_async_context(bus.subscribe(KEY, LATEST, history=False))
        gateway = stack.enter_context(process(command(variant, master, theirs), master))
        if variant != "zenoh_only":
            stack.enter_context(process([ROS_PYTHON, str(PEERS / "rospy_publisher.py")], master))
        async with asyncio.timeout(30):
            await anext(subscription)
        await asyncio.sleep(WARM_UP_S)
        cpu, frames, began = cpu_s(gateway), subscription.counts.received, time.perf_counter()
        await asyncio.sleep(seconds)
        elapsed = time.perf_counter() - began
        frames = subscription.counts.received - frames
        return Figure(frames / elapsed, (cpu_s(gateway) - cpu) * 1000 / frames)


def command(variant: str, master: str, settings: BusSettings) -> list[str]:
    """Return the command line of the process that is measured."""
    config = zenoh_config(settings)
    match variant:
        case "fleetsight":
            memory = "--shared-memory" if settings.shared_memory else "--no-shared-memory"
            options = ["--robot", "r1", "--ros-master", master, "--ros-host", "127.0.0.1", "--mode", "peer", memory]
            options += ["--compression", "raw"]
            return [sys.executable, "-m", "services.toolbox", "gateway", *options, "--connect", settings.connect[0]]
        case "rospy_naive":
            return [ROS_PYTHON, str(PEERS / "rospy_gateway.py"), config, KEY]
        case _:
            return [sys.executable, str(PEERS / "zenoh_publisher.py"), config, KEY]


def zenoh_config(settings: BusSettings) -> str:
    """Return the transport settings for a process that opens its own Zenoh session."""
    return json.dumps(session_config(settings))


@contextmanager
def process(arguments: Sequence[str], master: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run a process with a ROS environment and Zenoh's Python package; end it on leaving."""
    with tempfile.TemporaryDirectory() as folder:
        package = Path(zenoh.__file__).parent
        (Path(folder) / package.name).symlink_to(package)
        ros = {"ROS_MASTER_URI": master, "ROS_IP": "127.0.0.1"}
        path = {"PYTHONPATH": folder} if arguments[0] == ROS_PYTHON else {}
        words = Path(folder) / "stderr"
        with words.open("wb") as errors:
            child = subprocess.Popen(arguments, env={**os.environ, **ros, **path}, stderr=errors)
        try:
            yield child
        except TimeoutError:
            note(f"{Path(arguments[1]).name} said: {words.read_text(errors='replace')[-2000:]}")
            raise
        finally:
            child.terminate()
            try:
                child.wait(5)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()


@contextmanager
def ros_master() -> Iterator[str]:
    """Run Debian's rosmaster on a free port."""
    port = free_ports(1)
    uri = f"http://127.0.0.1:{port}"
    with process([ROSMASTER, "--core", "-p", str(port)], uri):
        yield uri


def cpu_s(child: subprocess.Popen[bytes]) -> float:
    """Return the user and system time of a process so far."""
    times = psutil.Process(child.pid).cpu_times()
    return float(times.user + times.system)


def note(text: str) -> None:
    """Show how far the run is."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


if __name__ == "__main__":
    main()
