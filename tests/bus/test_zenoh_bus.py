"""What only real sessions can show: routers that come, go and hang, processes that stop, clean-up, threads."""

import asyncio
import logging
import signal
import socket
import sys
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Final, TypeVar

import pytest

from bus import (
    LATEST,
    QUEUE,
    Bus,
    BusError,
    BusSettings,
    Presence,
    Publisher,
    QoS,
    Reply,
    Request,
    Subscription,
    open_bus,
)
from bus.zenoh_bus import ZenohBus

ROOT: Final = Path(__file__).parents[2]
KEY: Final = "fleet/r1/front/classes"
IMAGE_KEY: Final = "fleet/r1/front/color"
PATIENCE_S: Final = 60
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


FLOOD: Final = """
import asyncio, os, signal, sys
from bus import LATEST, BusSettings, QoS, open_bus

async def main() -> None:
    settings = BusSettings(connect=[sys.argv[1]], lease_s=30, shared_memory=False)
    async with open_bus(settings) as here, open_bus(settings) as there, here.subscribe("**", LATEST):
        async with there.publisher("image", QoS.IMAGE) as images:
            while not images.wanted:
                await asyncio.sleep(0.01)
            os.kill(int(sys.argv[2]), signal.SIGSTOP)
            for _ in range(50):
                images.put(bytes(1_000_000))
                await asyncio.sleep(0.01)

asyncio.run(main())
"""

FAIL: Final = """
import asyncio, logging, sys
from bus import LATEST, BusSettings, open_bus

logging.disable()

async def main() -> None:
    async with open_bus(BusSettings(connect=[sys.argv[1]])) as bus, bus.subscribe("**", LATEST):
        raise ValueError("on purpose")

asyncio.run(main())
"""

ABANDON: Final = """
import asyncio, sys, time
from bus import LATEST, BusSettings, QoS, open_bus

async def other(settings: BusSettings) -> None:
    async with open_bus(settings) as bus, bus.publisher("key", QoS.RESULT) as out, bus.announce("token"):
        for _ in range(50):
            out.put(b"x")
            await asyncio.sleep(0.01)

endpoint = sys.argv[1]
loop = asyncio.new_event_loop()
kept = open_bus(BusSettings(mode="router", listen=[endpoint]))
bus = loop.run_until_complete(kept.__aenter__())
subscribing, watching = bus.subscribe("**", LATEST), bus.watch("**")
subscription = loop.run_until_complete(subscribing.__aenter__())
watch = loop.run_until_complete(watching.__aenter__())
waiting = loop.create_task(anext(subscription))
loop.run_until_complete(asyncio.sleep(0))
loop.close()
asyncio.run(other(BusSettings(connect=[endpoint])))
assert subscription.counts.received > 0
waiting._log_destroy_pending = False
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


def warnings_in(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [
        record.getMessage()
        for record in caplog.records
        if record.levelno == logging.WARNING and record.name.startswith("bus.")
    ]


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
        await until(lambda: bool(warnings_in(caplog)))
        await asyncio.sleep(0.2)
        assert [endpoint in warning for warning in warnings_in(caplog)] == [True]
        async with open_bus(router(endpoint)) as hub, hub.subscribe(KEY, QUEUE(9)) as at_hub:
            assert (await next_of(at_hub)).payload == b"early"
            assert (await next_of(subscription)).payload == b"early"
            assert await next_of(watch) == Presence("worker", alive=True)
            await until(lambda: out.wanted)
    await until(lambda: bus_threads() == [])


async def big_frame(images: Publisher, frames: Subscription) -> int:
    """Put images, which a busy link drops, until one arrives; return its size."""
    before = frames.counts.received
    async with asyncio.timeout(PATIENCE_S):
        while frames.counts.received == before:
            images.put(bytes(1_000_000))
            await asyncio.sleep(0.2)
    return len((await next_of(frames)).payload)


async def test_everything_is_there_again_after_a_router_restart(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, logger="bus")
    endpoint = free_endpoint()
    async with (
        open_bus(client(endpoint)) as here,
        open_bus(client(endpoint)) as there,
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
                assert (await next_of(subscription)).payload == b"%d" % turn
                assert await big_frame(images, frames) == 1_000_000
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
    await until(lambda: bus_threads() == [])


async def test_an_endpoint_that_is_taken_is_an_error_at_once() -> None:
    endpoint = free_endpoint()
    async with open_bus(router(endpoint)):
        with pytest.raises(BusError, match="router"):
            async with open_bus(router(endpoint)):
                pytest.fail("this must not be entered")
    await until(lambda: bus_threads() == [])


async def test_an_endpoint_that_zenoh_panics_at_is_an_error_at_once() -> None:
    async with asyncio.timeout(PATIENCE_S):
        with pytest.raises(BusError, match="banana"):
            async with open_bus(BusSettings(connect=["tcp/127.0.0.1:7447?rel=banana"])):
                pass


async def test_opening_can_be_cancelled_while_nobody_answers() -> None:
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        opening = asyncio.create_task(
            enter_and_wait(lambda: open_bus(client(f"tcp/127.0.0.1:{silent.getsockname()[1]}")))
        )
        await asyncio.sleep(0.1)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening
        await until(lambda: bus_threads() == [])


async def enter_and_wait(make: Callable[[], AbstractAsyncContextManager[object]]) -> None:
    async with make():
        await asyncio.Event().wait()


async def never(_: Request) -> Reply:
    raise AssertionError("nobody asks")


DECLARATIONS: Final[dict[str, Callable[[Bus], AbstractAsyncContextManager[object]]]] = {
    "publisher": lambda bus: bus.publisher(KEY, QoS.RESULT),
    "subscribe": lambda bus: bus.subscribe(KEY, LATEST),
    "announce": lambda bus: bus.announce("worker"),
    "watch": lambda bus: bus.watch("**"),
    "serve": lambda bus: bus.serve("**", never),
}


@pytest.mark.parametrize("declare", DECLARATIONS.values(), ids=DECLARATIONS.keys())
async def test_cancelling_at_any_await_undeclares(
    declare: Callable[[Bus], AbstractAsyncContextManager[object]],
) -> None:
    """Cancel after so many turns of the loop, twice: while declaring, while inside, while undeclaring."""
    async with open_bus(router(free_endpoint())) as bus:
        assert isinstance(bus, ZenohBus)
        for turns in range(8):
            task = asyncio.create_task(enter_and_wait(lambda: declare(bus)))
            for _ in range(2):
                for _ in range(turns):
                    await asyncio.sleep(0)
                task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
        async with bus.publisher(KEY, QoS.IMAGE) as out, bus.watch("worker") as watch:
            assert len(bus._session._kept) == 2
            assert not out.wanted
            async with bus.announce("worker"):
                assert await next_of(watch) == Presence("worker", alive=True)
            assert await next_of(watch) == Presence("worker", alive=False)


async def test_closing_twice_cancelled_leaves_no_thread() -> None:
    for turns in range(6):
        task = asyncio.create_task(enter_and_wait(lambda: open_bus(router(free_endpoint()))))
        for _ in range(3):
            for _ in range(turns):
                await asyncio.sleep(0)
            task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
    await until(lambda: bus_threads() == [])


async def run_to_its_end(code: str, *arguments: str) -> tuple[int | None, bytes]:
    """Return a Python process's exit status and what it wrote to standard error."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", code, *arguments, cwd=ROOT, stderr=asyncio.subprocess.PIPE
    )
    try:
        async with asyncio.timeout(PATIENCE_S):
            _, errors = await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return process.returncode, errors


async def test_a_process_ends_though_its_router_hangs() -> None:
    endpoint = free_endpoint()
    async with running(ROUTER, endpoint, "30") as hub:
        ending = asyncio.create_task(run_to_its_end(FLOOD, endpoint, str(hub.pid)))
        status, errors = await ending
    assert (status, errors) == (0, b"")


async def test_a_process_ends_though_nobody_answers_and_it_fails() -> None:
    status, errors = await run_to_its_end(FAIL, free_endpoint())
    assert status == 1
    assert errors.endswith(b"ValueError: on purpose\n")


async def test_samples_that_arrive_after_the_loop_is_closed_do_no_harm() -> None:
    assert await run_to_its_end(ABANDON, free_endpoint()) == (0, b"")


async def test_closing_while_zenoh_still_calls_back_is_no_deadlock() -> None:
    """A deadlock over the interpreter lock costs Zenoh's ten seconds; it used to meet one round in ten."""
    for _ in range(60):
        async with asyncio.timeout(9), AsyncExitStack() as left_later, open_bus(router(free_endpoint())) as bus:
            out = await left_later.enter_async_context(bus.publisher(KEY, QoS.RESULT))
            await left_later.enter_async_context(bus.subscribe("**", LATEST))
            watch = await left_later.enter_async_context(bus.watch("**"))
            await left_later.enter_async_context(bus.announce(KEY))
            await until(lambda: out.wanted)  # noqa: B023 - awaited in the same turn
            await next_of(watch)


async def test_a_router_that_comes_and_goes_is_told() -> None:
    endpoint = free_endpoint()
    async with open_bus(client(endpoint)) as bus:
        assert bus.link_problem == f"there is no link to {endpoint}"
        for _ in range(2):
            async with open_bus(router(endpoint)) as there:
                async with asyncio.timeout(PATIENCE_S):
                    while bus.link_problem:  # noqa: ASYNC110 - nobody tells
                        await asyncio.sleep(0.01)
                assert there.link_problem == ""
            async with asyncio.timeout(PATIENCE_S):
                while not bus.link_problem:  # noqa: ASYNC110 - nobody tells
                    await asyncio.sleep(0.01)
    assert bus.link_problem == "the bus is closed"
