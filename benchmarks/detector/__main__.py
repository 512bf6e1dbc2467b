"""A detector worker against a bare loop over its model, side by side in one run.

    worker   `fleetsight detector`, a process of its own, fed raw 640x480 rgb8 frames over Zenoh's shared memory by four
             cameras, each of which sends its next frame when it has had the last one's detections, masks and tracks
    bare     a process that calls Ultralytics' own `predict` (with masks in the image's resolution, as the worker has
             them; without encoding them) on the same pictures in memory, one after the other, with as many threads as
             the worker, not pinned to cores either

each under the runtime that `--runtime auto --no-int8` chooses for the shipped model (worker_fps and bare_fps) and under
torch (torch_fps and bare_torch_fps), and the worker under what `--runtime auto` chooses (auto_fps and auto_runtime),
which may be INT8; on the processor unless `--device` names a GPU, at the model's own input size. The five are measured
in turn, the repeats too; figures are medians. The cameras' own work is on the same cores, which the bare loop has for
itself. Runtimes are exported and chosen anew for each run. `cameras_at_5_hz` is how many cameras with five images a
second each a worker under what `auto` chooses has time for.

overhead is from just before a frame is put on the bus (a gateway would have received it then) to its class list at a
subscriber, less the model's call, at 5 Hz. That call is what the runtime computes alone: pre- and post-processing are
overhead, whose stages (medians) are under `overhead_stages_ms`: `queue` before the model has time, `prepare` and
`postprocess`, and as `bus` the rest, both ways over the bus and from thread to thread. Memory is the worker's after so
many frames, and less what it was before them.
"""

import asyncio
import sys
import tempfile
from collections.abc import Sequence
from contextlib import AsyncExitStack, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.arguments import parser_of, show
from benchmarks.detector.feeding import Pictures, frames, overheads
from benchmarks.detector.report import medians, overhead, targets
from benchmarks.gateway.processes import PeerError, Process, module, running
from benchmarks.machine import machine, versions
from benchmarks.peers.views import SCENES, views
from benchmarks.progress import note
from bus import QUEUE, Bus, BusSettings, open_bus
from schemas import codec
from schemas.status import WorkerStatus
from schemas.worker_keys import EVERY_WORKER_STATUS
from services.toolbox.demo.children import free_ports

HZ: Final = 5.0
WARM_UP_FRAMES: Final = 300
"""By then all of the memory that cameras share with the worker is mapped, and its runtime has what it keeps."""

WORKERS: Final = {
    "auto_fps": ("--runtime", "auto"),
    "worker_fps": ("--runtime", "auto", "--no-int8"),
    "torch_fps": ("--runtime", "torch"),
}
"""What the speed of each worker is called, and its options."""
BARE: Final = {"bare_fps": "auto", "bare_torch_fps": "torch"}
"""What the speed of each bare loop is called, and its runtime."""
PACKAGES: Final = ("torch", "ultralytics-opencv-headless", "onnxruntime", "openvino", "eclipse-zenoh")


def main() -> None:
    """Measure and print."""
    parser = parser_of("benchmarks.detector", __doc__)
    parser.add_argument("--seconds", type=float, default=4.0, help="length of one measurement (default: 4)")
    parser.add_argument("--frames", type=int, default=2000, help="frames for the worker's memory (default: 2000)")
    parser.add_argument("--calls", type=int, default=200, help="frames for the overhead (default: 200)")
    parser.add_argument("--repeats", type=int, default=3, help="how often each is measured (default: 3)")
    parser.add_argument("--device", default="cpu", help="of workers and bare loops: cpu, cuda:0, ... (default: cpu)")
    arguments = parser.parse_args()
    plan = Plan(arguments.seconds, arguments.repeats, arguments.frames, arguments.calls, arguments.device)
    found = asyncio.run(measure(plan))
    show(found, as_json=arguments.json)


@dataclass(frozen=True, slots=True)
class Plan:
    """How long to measure, and where: seconds and repeats of each speed, frames for memory, calls for the overhead."""

    seconds: float
    repeats: int
    frames: int
    calls: int
    device: str


@dataclass(frozen=True, slots=True)
class Worker:
    """A running worker and the bus that it is on."""

    bus: Bus
    process: Process


async def measure(plan: Plan) -> dict[str, Any]:
    """Measure everything.

    Raises:
        PeerError: a process ended that was still needed.
    """
    pictures = views()
    with ExitStack() as stack:
        cache = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fleetsight-")))
        async with AsyncExitStack() as buses:
            device = ("--device", plan.device)
            workers = {
                name: await _worker([*options, *device], cache, pictures, stack, buses)
                for name, options in WORKERS.items()
            }
            bares = {name: stack.enter_context(running(_bare(each, cache, plan))) for name, each in BARE.items()}
            found = await _speeds(workers, bares, pictures, plan)
            found |= await _alone(workers["auto_fps"], pictures, plan)
    about = {"machine": machine(), "versions": versions(PACKAGES), "seeds": list(SCENES)}
    return {"targets": targets(found), **found, **about}


async def _worker(
    chosen: Sequence[str], cache: Path, pictures: Pictures, stack: ExitStack, buses: AsyncExitStack
) -> Worker:
    """Start a worker on a bus of its own; it has chosen and warmed up by then, with nobody else at work."""
    note(f"worker, {' '.join(chosen)}")
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    bus = await buses.enter_async_context(open_bus(BusSettings(mode="router", listen=[endpoint])))
    options = ["--connect", endpoint, *chosen, "--cache", str(cache)]
    process = stack.enter_context(running([sys.executable, "-m", "services.toolbox", "detector", *options]))
    try:
        await frames(bus, pictures, frames=WARM_UP_FRAMES)
    except TimeoutError as error:
        raise PeerError(process.last_words()) from error
    return Worker(bus, process)


def _bare(runtime: str, cache: Path, plan: Plan) -> list[str]:
    return module("bare_model", runtime, str(cache), str(plan.seconds), plan.device)


async def _speeds(
    workers: dict[str, Worker], bares: dict[str, Process], pictures: Pictures, plan: Plan
) -> dict[str, Any]:
    told = {}
    for name, bare in bares.items():
        note(f"bare loop, {BARE[name]}")
        told[name] = await asyncio.to_thread(bare.ask)
    speeds: dict[str, list[float]] = {name: [] for name in (*WORKERS, *BARE)}
    for repeat in range(plan.repeats):
        note(f"[{repeat + 1}/{plan.repeats}]")
        for name, worker in workers.items():
            speeds[name].append(await frames(worker.bus, pictures, seconds=plan.seconds))
        for name, bare in bares.items():
            speeds[name].append(float((await asyncio.to_thread(bare.ask))["fps"]))
    chosen, found = told["bare_fps"], medians(speeds)
    return {
        **found,
        "cameras_at_5_hz": int(found["auto_fps"] / HZ),
        "device": plan.device,
        "runtime": chosen["runtime"],
        "auto_runtime": await _runtime_of(workers["auto_fps"].bus),
        "side": chosen["side"],
    }


async def _runtime_of(bus: Bus) -> str:
    async with bus.subscribe(EVERY_WORKER_STATUS, QUEUE(16)) as statuses:
        async for sample in statuses:
            return codec.decode(WorkerStatus, sample.payload, sample.encoding).runtime
    raise PeerError("a worker's status does not come")


async def _alone(worker: Worker, pictures: Pictures, plan: Plan) -> dict[str, Any]:
    note("overhead")
    found = overhead(await overheads(worker.bus, pictures, hz=HZ, number=plan.calls))
    note("memory")
    await frames(worker.bus, pictures, frames=WARM_UP_FRAMES)
    before = worker.process.rss_bytes()
    await frames(worker.bus, pictures, frames=plan.frames)
    after = worker.process.rss_bytes()
    return {
        **found,
        "rss_mb": round(after / 1e6),
        "rss_growth_mb": round((after - before) / 1e6, 2),
        "rss_frames": plan.frames,
    }


if __name__ == "__main__":
    main()
