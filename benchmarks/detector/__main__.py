"""A detector worker against a bare loop over its model, side by side in one run of about eight minutes.

    worker   `fleetsight detector`, a process of its own, fed raw 640x480 rgb8 frames over Zenoh's shared memory by four
             cameras, each of which sends its next frame when it has had the last one's detections, masks and tracks
    bare     a process that calls Ultralytics' own `predict` (with masks in the image's resolution, as the worker has
             them; without encoding them) on the same pictures in memory, one after the other

each under torch and under the runtime that `--runtime auto` chooses, at the longer side that the shipped model was
trained at and at 640. The four are measured in turn, the repeats too; figures are medians. The cameras' own work is on
the same cores, which the bare loop has for itself.

overhead is from just before a frame is put on the bus (a gateway would have received it then) to its class list at a
subscriber, less the model's call, at 5 Hz. Memory is the worker's after so many frames, less before them.
"""

import argparse
import asyncio
import json
import statistics
import sys
from contextlib import AsyncExitStack, ExitStack
from dataclasses import dataclass
from typing import Any, Final

from benchmarks.detector.feeding import frames, overheads_ms
from benchmarks.gateway.processes import Process, module, running
from benchmarks.machine import machine, versions
from benchmarks.peers.views import views
from benchmarks.progress import note
from benchmarks.targets import at_least, at_most
from bus import Bus, BusSettings, open_bus
from services.toolbox.demo.ports import free_ports

HZ: Final = 5.0
WARM_UP_FRAMES: Final = 100
RUNTIMES: Final = ("auto", "torch")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.detector", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--seconds", type=float, default=4.0, help="length of one measurement (default: 4)")
    parser.add_argument("--frames", type=int, default=2000, help="frames for the worker's memory (default: 2000)")
    parser.add_argument("--calls", type=int, default=200, help="frames for the overhead (default: 200)")
    parser.add_argument("--repeats", type=int, default=3, help="how often each is measured (default: 3)")
    parser.add_argument("--only-own-side", action="store_true", help="leave 640 pixels out")
    arguments = parser.parse_args()
    plan = Plan(
        arguments.seconds, arguments.repeats, arguments.frames, arguments.calls, only_own_side=arguments.only_own_side
    )
    found = asyncio.run(measure(plan))
    print(json.dumps(found) if arguments.json else "\n".join(f"{name}: {value}" for name, value in found.items()))


@dataclass(frozen=True, slots=True)
class Plan:
    """How long to measure: seconds and repeats of each speed, frames for memory, calls for the overhead."""

    seconds: float
    repeats: int
    frames: int
    calls: int
    only_own_side: bool


async def measure(plan: Plan) -> dict[str, Any]:
    """Measure everything."""
    pictures = views()
    side = await asyncio.to_thread(_own_side)
    found: dict[str, Any] = {"side": side}
    for size in (side,) if plan.only_own_side or side == 640 else (side, 640):
        ending = "" if size == side else f"_{size}"
        with ExitStack() as stack:
            async with AsyncExitStack() as buses:
                workers = {name: await _worker(name, size, stack, buses) for name in RUNTIMES}
                for bus, _ in workers.values():  # exports are made and runtimes chosen by now, and nobody does it twice
                    await frames(bus, pictures, frames=WARM_UP_FRAMES)
                bares = {name: stack.enter_context(running(_bare(name, size, plan.seconds), "")) for name in RUNTIMES}
                found |= await _speeds(workers, bares, pictures, plan, ending)
                if size == side:
                    bus, process = workers["auto"]
                    note("overhead")
                    found |= _overhead(await overheads_ms(bus, pictures, hz=HZ, number=plan.calls))
                    note("memory")
                    await frames(bus, pictures, frames=WARM_UP_FRAMES)
                    before = process.rss_bytes()
                    await frames(bus, pictures, frames=plan.frames)
                    found["rss_growth_mb"] = round((process.rss_bytes() - before) / 1e6, 2)
                    found["rss_frames"] = plan.frames
    packages = ["torch", "ultralytics-opencv-headless", "onnxruntime", "openvino", "eclipse-zenoh"]
    return {"targets": _targets(found), **found, "machine": machine(), "versions": versions(packages)}


def _own_side() -> int:
    """Return the longer side that the shipped model was trained at."""
    import tempfile  # noqa: PLC0415
    from pathlib import Path  # noqa: PLC0415

    from services.detector.runtime.offline import keep_offline  # noqa: PLC0415
    from services.detector.settings import SHIPPED_MODEL  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder:
        keep_offline(Path(folder), download=False)
        from services.detector.runtime.weights import load_weights  # noqa: PLC0415

        return load_weights(str(SHIPPED_MODEL)).longest


async def _worker(runtime: str, side: int, stack: ExitStack, buses: AsyncExitStack) -> tuple[Bus, Process]:
    """Start a worker on a bus of its own."""
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    bus = await buses.enter_async_context(open_bus(BusSettings(mode="router", listen=[endpoint])))
    options = ["--connect", endpoint, "--runtime", runtime, "--image-size", str(side), "--device", "cpu"]
    command = [sys.executable, "-m", "services.toolbox", "detector", *options]
    return bus, stack.enter_context(running(command, ""))


def _bare(runtime: str, side: int, seconds: float) -> list[str]:
    return module("bare_model", runtime, str(side), str(seconds))


async def _speeds(
    workers: dict[str, tuple[Bus, Process]],
    bares: dict[str, Process],
    pictures: list[Any],
    plan: Plan,
    ending: str,
) -> dict[str, Any]:
    speeds: dict[str, list[float]] = {}
    chosen: dict[str, str] = {}
    for name in RUNTIMES:
        chosen[name] = str((await asyncio.to_thread(bares[name].ask))["runtime"])
    for repeat in range(plan.repeats):
        for name in RUNTIMES:
            note(f"[{repeat + 1}/{plan.repeats}] {name} ({chosen[name]}){ending}")
            speeds.setdefault(f"{name}_fps{ending}", []).append(
                await frames(workers[name][0], pictures, seconds=plan.seconds)
            )
            told = await asyncio.to_thread(bares[name].ask)
            speeds.setdefault(f"bare_{name}_fps{ending}", []).append(float(str(told["fps"])))
    medians = {name: round(statistics.median(values), 2) for name, values in speeds.items()}
    spread = {name: [round(min(values), 2), round(max(values), 2)] for name, values in speeds.items()}
    return {**medians, f"spread{ending}": spread, f"runtime{ending}": chosen["auto"]}


def _overhead(found: list[float]) -> dict[str, float]:
    ordered = sorted(found)
    return {
        "overhead_p50_ms": round(statistics.median(ordered), 2),
        "overhead_p99_ms": round(ordered[min(len(ordered) - 1, int(len(ordered) * 0.99))], 2),
        "overhead_samples": len(ordered),
    }


def _targets(found: dict[str, Any]) -> dict[str, Any]:
    endings = ("", "_640") if "auto_fps_640" in found else ("",)
    reached: dict[str, Any] = {}
    for ending in endings:
        reached |= at_least(found, f"auto_fps{ending}", f"bare_auto_fps{ending}", 0.9)
        reached |= at_least(found, f"torch_fps{ending}", f"bare_torch_fps{ending}", 0.9)
        reached |= at_least(found, f"auto_fps{ending}", f"torch_fps{ending}", 1.3)
    for name, limit in (("overhead_p50_ms", 6), ("overhead_p99_ms", 25), ("rss_growth_mb", 20)):
        reached |= at_most(found, name, limit)
    return reached


if __name__ == "__main__":
    main()
