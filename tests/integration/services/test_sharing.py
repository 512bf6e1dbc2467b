"""Real workers over a real router: the cameras of one that is killed go to the others, and no other camera moves."""

import asyncio
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

import pytest

from bus import QUEUE, BusSettings, Subscription, open_bus
from schemas import keys
from schemas.detections import ClassList
from schemas.keys import Stream
from schemas.worker_keys import MAX_WEIGHT, WorkerAlive
from services.toolbox.demo.children import free_ports
from tests.integration.fleet import PATIENCE_S
from tests.integration.services.serving import served

ROBOTS, CAMERAS = 2, 4
WORKERS = ("w1", "w2", "w3")


@asynccontextmanager
async def peer(name: str, *arguments: str) -> AsyncIterator[Process]:
    """Run one of the benchmarks' processes."""
    command = [sys.executable, "-m", f"benchmarks.peers.{name}", *arguments]
    process = await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=DEVNULL, stderr=DEVNULL)
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


async def owners(lists: Subscription, among: set[str]) -> dict[str, str]:
    """Take results until those of each camera come from one of the workers."""
    return await served(lists, ClassList, lambda found: len(found) == ROBOTS * CAMERAS and set(found.values()) <= among)


async def shared(lists: Subscription) -> dict[str, str]:
    """Take results until every worker has some, and nothing has changed for a while."""
    before: dict[str, str] = {}
    async with asyncio.timeout(PATIENCE_S):
        while True:
            found = await owners(lists, set(WORKERS))
            if found == before and set(found.values()) == set(WORKERS):
                return found
            before = found
            await asyncio.sleep(0.3)


@pytest.mark.timeout(180)
async def test_the_cameras_of_a_worker_that_is_killed_go_to_the_others() -> None:
    router = f"tcp/127.0.0.1:{free_ports(1)}"
    settings = BusSettings(mode="router", listen=[router], shared_memory=False)
    async with (
        open_bus(settings) as bus,
        bus.subscribe(keys.every_stream(Stream.CLASSES), QUEUE(1000), history=False) as lists,
        AsyncExitStack() as stack,
    ):
        await stack.enter_async_context(peer("fleet_cameras", router, str(ROBOTS), str(CAMERAS), "10"))
        running = {
            name: await stack.enter_async_context(peer("stand_in_worker", router, name, "1")) for name in WORKERS
        }
        before = await shared(lists)
        running["w2"].kill()
        after = await owners(lists, {"w1", "w3"})
    assert "w2" in before.values()
    assert {camera: after[camera] for camera, worker in before.items() if worker != "w2"} == {
        camera: worker for camera, worker in before.items() if worker != "w2"
    }


@pytest.mark.timeout(180)
async def test_a_worker_that_wins_every_camera_and_serves_none_takes_none_away() -> None:
    router = f"tcp/127.0.0.1:{free_ports(1)}"
    idle = WorkerAlive("detector", "idle", weight=MAX_WEIGHT)
    async with (
        open_bus(BusSettings(mode="router", listen=[router], shared_memory=False)) as bus,
        bus.announce(str(idle)),
        bus.subscribe(keys.every_stream(Stream.CLASSES), QUEUE(1000), history=False) as lists,
        peer("fleet_cameras", router, str(ROBOTS), str(CAMERAS), "10"),
        peer("stand_in_worker", router, "w1", "1"),
    ):
        assert set((await owners(lists, {"w1"})).values()) == {"w1"}
