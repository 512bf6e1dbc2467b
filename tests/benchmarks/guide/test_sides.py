import asyncio
import sys
from collections.abc import Mapping

import pytest

from benchmarks.gateway.processes import PeerError, Process, running
from benchmarks.guide.robot import Robot
from benchmarks.guide.scene import Scene
from benchmarks.guide.sets import Arrival
from benchmarks.guide.sides import Side, process_error
from gateway.to_ros.outputs import STRING
from services.toolbox.demo.children import Child, child

TOPIC = "/classes"
LIMIT_S = 30.0


class Bench(Robot):
    """A robot whose outputs come when it has been driven a few times. silent: they never come."""

    def __init__(self, *, silent: bool) -> None:
        super().__init__(Scene(1), {TOPIC: STRING}, {})
        self._silent = silent

    async def drive(self, hz: float, seconds: float) -> list[int]:
        await asyncio.sleep(seconds / hz / 10)
        if not self._silent:
            self.arrivals.append(Arrival(TOPIC, 1, 0, 1))
        return []


def side(processes: Mapping[str, Process | Child], *, silent: bool = True) -> Side:
    return Side(Bench(silent=silent), processes)


async def test_a_service_that_ends_is_named_at_once_with_its_reason() -> None:
    async with asyncio.timeout(LIMIT_S), child("detector", ["detector", "--runtime", "nonsense"], print) as detector:
        with pytest.raises(PeerError, match=r"^detector ended with exit code 2: .*runtime.*nonsense"):
            await side({"detector": detector}).ready()


async def test_a_node_that_ends_is_named_at_once_with_its_reason() -> None:
    with running([sys.executable, "-c", "raise SystemExit('no camera here')"]) as node:
        async with asyncio.timeout(LIMIT_S):
            with pytest.raises(PeerError, match=r"^images ended: .*no camera here"):
                await side({"images": node}).ready()


async def test_one_that_ended_is_no_side_even_if_all_outputs_come() -> None:
    with running([sys.executable, "-c", ""]) as ended, running([sys.executable, "-c", "input()"]) as runs:
        async with asyncio.timeout(LIMIT_S):
            await side({"classes": runs}, silent=False).ready()
            while ended.runs():  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.01)
            with pytest.raises(PeerError, match=r"^distance ended: "):
                await side({"classes": runs, "distance": ended}, silent=False).ready()


def test_what_is_wrong_with_a_process_alone_is_found_among_tasks() -> None:
    ended = PeerError("detector ended")
    assert process_error(ended) is ended
    assert process_error(ExceptionGroup("", [ExceptionGroup("", [ended])])) is ended
    assert process_error(ExceptionGroup("", [ended, ValueError()])) is None
    assert process_error(ExceptionGroup("", [ValueError()])) is None
