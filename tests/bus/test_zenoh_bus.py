"""What only real sessions can show: routers that come, go and hang, processes that stop, clean-up, threads."""

import asyncio
import logging
import signal
import socket
import sys
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final, TypeVar

import pytest

from bus import LATEST, QUEUE, BusSettings, Presence, QoS, open_bus

ROOT: Final = Path(__file__).parents[2]
KEY: Final = "fleet/r1/front/classes"
IMAGE_KEY: Final = "fleet/r1/front/color"
PATIENCE_S: Final = 20
LEASE_S: Final = 1.0

T = TypeVar("T")

ROUTER: Final = """
import asyncio, sys
from bus import BusSettings, open_bus

async def main() -> None:
    async with open_bus(BusSettings(mode="router", listen=[sys.argv[1]], lease_s=float(sys.argv[2]))):
        print("ready", flush=True)
        await asyncio.Event().wait()

asyncio.run(main())
"""

PRESENT: Final = """
import asyncio, sys
from bus import BusSettings, open_bus

async def main() -> None:
    async with open_bus(BusSettings(connect=[sys.argv[1]], lease_s=float(sys.argv[2]))) as bus, bus.announce("worker"):
        print("ready", flush=True)
        await asyncio.Event().wait()

asyncio.run(main())
"""


def free_endpoint() -> str:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{bound.getsockname()[1]}"


def client(endpoint: str) -> BusSettings:
    return BusSettings(connect=[endpoint], lease_s=LEASE_S)


def router(endpoint: str) -> BusSettings:
    return BusSettings(mode="router", listen=[endpoint], lease_s=LEASE_S)


@asynccontextmanager
async def running(code: str, *arguments: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """Run Python in a process of its own until leaving; entered when it says it is ready."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", code, *arguments, cwd=ROOT, stdout=asyncio.subprocess.PIPE
    )
    try:
        assert process.stdout is not None
        async with asyncio.timeout(PATIENCE_S):
            assert await process.stdout.readline() == b"ready\n"
        yield process
    finally:
        if process.returncode is None:
            process.send_signal(signal.SIGCONT)
            process.kill()
        await process.communicate()


async def next_of(source: AsyncIterator[T]) -> T:
    async with asyncio.timeout(PATIENCE_S):
        return await anext(source)


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - what is waited for tells nobody
            await asyncio.sleep(0.01)


def bus_threads() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("bus-")]


async def test_a_client_waits_for_its_router(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, logger="bus")
    endpoint = free_endpoint()
    async with (
        open_bus(client(endpoint)) as bus,
        bus.subscribe("fleet/**", QUEUE(9)) as subscription,
        bus.publisher(KEY, QoS.RESULT) as out,
        bus.publisher(IMAGE_KEY, QoS.IMAGE),
        bus.announce("worker"),
        bus.watch("*") as watch,
    ):
        assert not out.wanted
        out.put(b"early")
        await asyncio.sleep(1.2)
        waiting = [record for record in caplog.records if record.levelno == logging.WARNING]
        assert [endpoint in record.getMessage() for record in waiting] == [True]
        async with open_bus(router(endpoint)) as hub, hub.subscribe(KEY, QUEUE(9)) as at_hub:
            assert (await next_of(at_hub)).payload == b"early"
            assert (await next_of(subscription)).payload == b"early"
            assert await next_of(watch) == Presence("worker", alive=True)
            await until(lambda: out.wanted)
    assert bus_threads() == []


async def test_everything_is_there_again_after_a_router_restart(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, logger="bus")
    endpoint = free_endpoint()
    async with open_bus(client(endpoint)) as here, open_bus(client(endpoint)) as there:
        async with (
            there.publisher(KEY, QoS.RESULT) as out,
            there.publisher(IMAGE_KEY, QoS.IMAGE) as images,
            there.announce("worker"),
            here.subscribe("fleet/*/*/classes", QUEUE(9)) as subscription,
            here.subscribe("fleet/*/*/color", LATEST, history=False) as frames,
            here.watch("worker") as watch,
        ):
            for turn in range(2):
                async with running(ROUTER, endpoint, str(LEASE_S)):
                    assert await next_of(watch) == Presence("worker", alive=True)
                    await until(lambda: out.wanted and images.wanted)
                    if turn:
                        assert (await next_of(subscription)).payload == b"while away"
                    out.put(b"%d" % turn)
                    images.put(bytes(1_000_000))
                    assert (await next_of(subscription)).payload == b"%d" % turn
                    assert len((await next_of(frames)).payload) == 1_000_000
                assert await next_of(watch) == Presence("worker", alive=False)
                await until(lambda: not out.wanted and not images.wanted)
                out.put(b"while away")
            assert subscription.counts.received == 3
    messages = [record.getMessage() for record in caplog.records]
    assert len([message for message in messages if message.startswith("lost the router")]) == 4


async def test_a_process_that_hangs_is_gone_after_the_lease_and_comes_back() -> None:
    endpoint = free_endpoint()
    async with (
        open_bus(router(endpoint)) as bus,
        bus.watch("worker") as watch,
        running(PRESENT, endpoint, str(LEASE_S)) as process,
    ):
        assert await next_of(watch) == Presence("worker", alive=True)
        process.send_signal(signal.SIGSTOP)
        assert await next_of(watch) == Presence("worker", alive=False)
        process.send_signal(signal.SIGCONT)
        assert await next_of(watch) == Presence("worker", alive=True)
        process.kill()
        assert await next_of(watch) == Presence("worker", alive=False)


async def test_a_router_that_hangs_holds_nobody_up(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, logger="asyncio")
    asyncio.get_running_loop().slow_callback_duration = 0.5
    endpoint = free_endpoint()
    async with running(ROUTER, endpoint, "30") as hub:
        here_settings = BusSettings(connect=[endpoint], lease_s=30, shared_memory=False)
        async with (
            open_bus(here_settings) as here,
            open_bus(here_settings) as there,
            here.subscribe("fleet/**", LATEST),
            there.publisher(KEY, QoS.RESULT) as out,
            there.publisher(IMAGE_KEY, QoS.IMAGE) as images,
        ):
            await until(lambda: out.wanted and images.wanted)
            hub.send_signal(signal.SIGSTOP)
            for _ in range(100):
                out.put(b"x" * 1_000)
                images.put(bytes(1_000_000))
                await asyncio.sleep(0.01)
            async with there.announce("worker"), there.watch("**"), there.subscribe("**", LATEST):
                pass
    assert [record.getMessage() for record in caplog.records] == []
