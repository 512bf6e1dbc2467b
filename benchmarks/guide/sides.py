"""The two sides: the guide's nodes and fleetsight's processes, each beside a robot of its own."""

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks.gateway.processes import PeerError, Process, cpu_s, module, ros_master, running
from benchmarks.guide.outputs import FLEETSIGHT, GUIDE
from benchmarks.guide.robot import Robot, robot
from benchmarks.guide.scene import Scene
from benchmarks.guide.sets import Arrival
from benchmarks.guide.topics import CLASSES, DISTANCE, OBJECTS_SHOWN, SEGMENTATION
from services.detector.settings import SHIPPED_MODEL
from services.toolbox.demo.children import Child, ChildFailedError, child, free_ports

NODES: Final = {"images": SEGMENTATION, "classes": CLASSES, "distance": DISTANCE, "cloud": OBJECTS_SHOWN}
"""The guide's nodes, and the last topic that each of them publishes for an image."""
CONFIDENCE: Final = 0.25
"""Ultralytics' own, which the guide leaves as it is."""
START_S: Final = 600.0
READY_HZ: Final = 2.0
QUIET_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class Side:
    """One side. processes: by what they do. endpoint: of its Zenoh router; the guide has none.

    lasts: what comes last of an image, of processes that do not work on the same images.
    """

    robot: Robot
    processes: Mapping[str, Process | Child]
    endpoint: str = ""
    lasts: Mapping[str, str] = field(default_factory=dict)

    def shares(self, arrivals: Sequence[Arrival]) -> dict[str, int]:
        """Return of how many images each of those processes is done that do not wait for each other."""
        counts = Counter(each.topic for each in arrivals)
        return {name: counts[topic] for name, topic in self.lasts.items()}

    def cpu_s(self) -> dict[str, float]:
        """Return the processor time of each of its processes so far."""
        return {name: cpu_s(_pid(process)) for name, process in self.processes.items()}

    async def ready(self) -> None:
        """Drive until every output has come.

        Raises:
            PeerError: a process ended, or an output never came; says what the processes said.
        """
        missing = set(self.robot.outputs)
        for _ in range(round(START_S * READY_HZ)):
            for name, process in self.processes.items():
                await _check_running(name, process)
            await self.robot.drive(READY_HZ, 1 / READY_HZ)
            missing -= {each.topic for each in self.robot.taken()}
            if not missing:
                return
        words = (f"{name}: {_last_words(process)}" for name, process in self.processes.items())
        raise PeerError("; ".join([f"nothing came on {', '.join(sorted(missing))}", *words]))

    async def quiet(self) -> None:
        """Wait until nothing arrives any more, and forget what did."""
        await asyncio.sleep(QUIET_S)
        while self.robot.taken():  # noqa: ASYNC110 - nobody tells that nothing comes
            await asyncio.sleep(QUIET_S)


def _pid(process: Process | Child) -> int:
    return process.pid if isinstance(process, Process) else process.process.pid


async def _check_running(name: str, process: Process | Child) -> None:
    """Raise PeerError if a process has ended."""
    if isinstance(process, Process):
        if not process.runs():
            raise PeerError(f"{name} ended: {process.last_words()}")
    elif process.process.returncode is not None:
        try:
            await process.ended()
        except ChildFailedError as error:
            raise PeerError(str(error)) from error


def _last_words(process: Process | Child) -> str:
    return process.last_words() if isinstance(process, Process) else process.last_words or "it said nothing"


def process_error(error: Exception) -> PeerError | None:
    """Return what is wrong with a process, if that is all that is wrong."""
    while isinstance(error, ExceptionGroup) and len(error.exceptions) == 1:
        error = error.exceptions[0]
    return error if isinstance(error, PeerError) else None


@asynccontextmanager
async def guide(scene: Scene) -> AsyncIterator[Side]:
    """Run the guide's nodes, each in a process of its own as the guide has them; all outputs have come once."""
    async with AsyncExitStack() as stack:
        master = stack.enter_context(ros_master())
        nodes = {
            name: stack.enter_context(running(module("with_ros", "guide_node", str(SHIPPED_MODEL), name), master))
            for name in NODES
        }
        made = await stack.enter_async_context(robot(master, scene, GUIDE))
        side = Side(made, nodes, lasts=NODES)
        await side.ready()
        yield side


@asynccontextmanager
async def fleetsight(scene: Scene, runtime: str, folder: Path) -> AsyncIterator[Side]:
    """Run fleetsight as its users start it; all outputs have come once. folder: for its cache and its history."""
    port = free_ports(2)
    endpoint = f"tcp/127.0.0.1:{port}"
    connect = ["--connect", endpoint]
    async with AsyncExitStack() as stack:
        master = stack.enter_context(ros_master())
        history = f"sqlite:///{folder}/{runtime}.db"
        detector = ["--runtime", runtime, "--device", "cpu", "--confidence", str(CONFIDENCE), "--cache", str(folder)]
        commands = {
            "monitor": ["--listen", endpoint, "--web-port", str(port + 1), "--history", history],
            "gateway": [*connect, "--robot", "r1", "--ros-master", master, "--ros-host", "127.0.0.1"],
            "detector": [*connect, *detector],
            "distance": connect,
            "cloud": connect,
        }
        children = {
            name: await stack.enter_async_context(child(name, [name, *options], _unsaid))
            for name, options in commands.items()
        }
        made = await stack.enter_async_context(robot(master, scene, FLEETSIGHT))
        side = Side(made, children, endpoint)
        await side.ready()
        yield side


def _unsaid(_: str) -> None:
    pass
