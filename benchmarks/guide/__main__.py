"""The guide's pipeline and fleetsight on the same robot, side by side in one run.

A simulated robot publishes 640x480 colour, depth registered to it and coloured points, pre-rendered, under the guide's
own topic names. Both sides have the same weights, cores and confidence, and somebody on ROS subscribes to every output:

    guide             its steps in our words: four rospy nodes on Debian's ROS 1 that call Ultralytics' model once for
                      each annotated image, for the class list, the distances and the cloud of each object
    fleetsight_torch  gateway, detector under torch, distance, cloud and monitor, as their users start them
    fleetsight_best   the same with the runtime that the detector chooses for this machine

A set is every output of one image: two annotated images, class list, distances, object clouds. The guide's outputs do
not say of which image they are, so its sets are as many as the rarest of its outputs, whichever images those are of.
Where it would show each object's cloud in a window it sends a text, and the depth image that its distances are made of
is a frame older than its age says, since it waits for the next colour image.

*_sets_per_s_* are at --hz images a second, more than any side can do; the sides take turns, medians of the repeats.
*_age_p50_ms_1hz are from the camera's stamp to the last output of the set, at its subscriber on ROS, at 1 Hz; that of
fleetsight is under the best runtime. Processor time is of the side's processes; each node of the guide works on images
of its own, so a set's is the sum of what each takes for one. *_balanced_sets_per_s is what a side's processor time is
worth in sets if it is spread over its processes as sets need it, which flooded nodes do not do by themselves. hops is
one image's way through fleetsight, at 1 Hz, each hop's median beside what it cannot be quicker than.

Needs Debian's ROS 1.
"""

import asyncio
import json
import tempfile
import time
from collections.abc import Sequence
from contextlib import AsyncExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import psutil

from benchmarks.arguments import at_least_one, parser_of
from benchmarks.gateway.processes import ROSMASTER, PeerError
from benchmarks.guide.hops import lines
from benchmarks.guide.report import Run, Runs, figures, targets
from benchmarks.guide.scene import SEED, Scene
from benchmarks.guide.sets import ages_ms, complete
from benchmarks.guide.sides import Side, fleetsight, guide, process_error
from benchmarks.guide.way import way
from benchmarks.machine import machine, versions
from benchmarks.progress import note

SETTLE_S: Final = 2.0
SLOW_HZ: Final = 1.0
PACKAGES: Final = ("torch", "ultralytics-opencv-headless", "onnxruntime", "openvino", "eclipse-zenoh")


@dataclass(frozen=True, slots=True)
class Plan:
    """How long to measure. instants: how many different views there are. hz: of the flood. slow: images at 1 Hz."""

    instants: int
    hz: float
    seconds: float
    repeats: int
    slow: int


def main(given: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = parser_of("benchmarks.guide", __doc__)
    parser.add_argument("--hz", type=float, default=20.0, help="images a second of the flood (default: 20)")
    parser.add_argument("--seconds", type=float, default=8.0, help="length of one measurement (default: 8)")
    parser.add_argument("--repeats", type=at_least_one, default=3, help="how often each is measured (default: 3)")
    parser.add_argument("--slow", type=at_least_one, default=15, help="images at 1 Hz (default: 15)")
    parser.add_argument("--instants", type=at_least_one, default=12, help="different views (default: 12)")
    arguments = parser.parse_args(given)
    if not Path(ROSMASTER).exists():
        parser.error("Debian's ROS 1 is not installed; tests/install/ros.sh installs it")
    plan = Plan(arguments.instants, arguments.hz, arguments.seconds, arguments.repeats, arguments.slow)
    try:
        found = asyncio.run(measure(plan))
    except (PeerError, ExceptionGroup) as error:
        if (cause := process_error(error)) is None:
            raise
        parser.exit(1, f"{parser.prog}: {cause}\n")
    if arguments.json:
        print(json.dumps(found))
        return
    hops = found.pop("hops")
    print("\n".join([*(f"{name}: {value}" for name, value in found.items()), *lines(hops)]))


async def measure(plan: Plan) -> dict[str, Any]:
    """Measure everything.

    Raises:
        PeerError: a process ended or was silent that was still needed.
    """
    note("rendering")
    scene = await asyncio.to_thread(Scene, plan.instants)
    with tempfile.TemporaryDirectory(prefix="fleetsight-") as folder:
        async with AsyncExitStack() as stack:
            sides = {}
            for name, starting in {
                "guide": guide(scene),
                "fleetsight_torch": fleetsight(scene, "torch", Path(folder)),
                "fleetsight_best": fleetsight(scene, "auto", Path(folder)),
            }.items():
                note(f"starting {name}")
                sides[name] = await stack.enter_async_context(starting)
            found = figures(await _runs(sides, plan))
            note("hop by hop")
            found |= await way(sides["fleetsight_best"], sides["guide"], scene, plan.slow, Path(folder))
    return {"targets": targets(found), **found, **_conditions(plan)}


async def _runs(sides: dict[str, Side], plan: Plan) -> dict[str, Runs]:
    runs = {name: Runs() for name in sides}
    for repeat in range(plan.repeats):
        for name, side in sides.items():
            note(f"[{repeat + 1}/{plan.repeats}] {name}, flooded")
            await side.ready()
            await side.robot.drive(plan.hz, SETTLE_S)
            side.robot.taken()
            runs[name].flooded.append(await _run(side, plan.hz, plan.seconds))
            await side.quiet()
    for name, side in sides.items():
        note(f"{name}, at 1 Hz")
        await side.ready()
        await side.quiet()
        runs[name].slow.append(await _run(side, SLOW_HZ, plan.slow / SLOW_HZ))
        await side.quiet()
    return runs


async def _run(side: Side, hz: float, seconds: float) -> Run:
    """Drive, and account for what came of it."""
    own, before, busy, began_s = psutil.Process(), side.cpu_s(), _busy_s(), time.monotonic()
    own_s = sum(own.cpu_times()[:2])
    stamps = await side.robot.drive(hz, seconds)
    elapsed_s = time.monotonic() - began_s
    spent = {name: now - before[name] for name, now in side.cpu_s().items()}
    others_s = _busy_s() - busy - sum(spent.values()) - (sum(own.cpu_times()[:2]) - own_s)
    arrivals = side.robot.taken()
    return Run(
        seconds=elapsed_s,
        sets=complete(arrivals, side.robot.outputs),
        cpu_s=spent,
        shares=side.shares(arrivals),
        ages_ms=ages_ms(arrivals, side.robot.outputs, stamps),
        others_cores=max(0.0, others_s / elapsed_s),
    )


def _busy_s() -> float:
    """Return the processor time of everything on the machine so far."""
    times = psutil.cpu_times()
    return float(times.user + times.nice + times.system)


def _conditions(plan: Plan) -> dict[str, Any]:
    return {
        "frame": "640x480 rgb8",
        **asdict(plan),
        "machine": machine(),
        "versions": versions(PACKAGES),
        "seeds": [SEED],
    }


if __name__ == "__main__":
    main()
