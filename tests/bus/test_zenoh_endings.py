"""How real sessions end: cancelled, closed, abandoned, with a router that hangs."""

import asyncio
import socket
import sys
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from typing import Final

import pytest

from bus import LATEST, Bus, Presence, QoS, open_bus
from bus.zenoh_bus import ZenohBus
from tests.bus.sessions import ROOT, ROUTER, bus_threads, client, never, router, running
from tests.contract.conftest import free_endpoint
from tests.waiting import PATIENCE_S, next_of, until

KEY: Final = "fleet/r1/front/classes"

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
subscribing, watching, more = bus.subscribe("**", LATEST), bus.watch("**"), bus.watch("fleet/**")
subscription = loop.run_until_complete(subscribing.__aenter__())
watches = [loop.run_until_complete(each.__aenter__()) for each in (watching, more)]
waiting = loop.create_task(anext(subscription))
loop.run_until_complete(asyncio.sleep(0))
loop.close()
asyncio.run(other(BusSettings(connect=[endpoint])))
assert subscription.counts.received > 0
waiting._log_destroy_pending = False
"""


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
        before = len(bus._session._kept)
        for turns in range(8):
            task = asyncio.create_task(enter_and_wait(lambda: declare(bus)))
            for _ in range(2):
                for _ in range(turns):
                    await asyncio.sleep(0)
                task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
        async with bus.publisher(KEY, QoS.IMAGE) as out, bus.watch("worker") as watch:
            assert len(bus._session._kept) == before + 2
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
    """A deadlock over the interpreter lock costs Zenoh's ten seconds."""
    for _ in range(60):
        async with asyncio.timeout(9), AsyncExitStack() as left_later, open_bus(router(free_endpoint())) as bus:
            out = await left_later.enter_async_context(bus.publisher(KEY, QoS.RESULT))
            await left_later.enter_async_context(bus.subscribe("**", LATEST))
            watch = await left_later.enter_async_context(bus.watch("**"))
            await left_later.enter_async_context(bus.announce(KEY))
            await until(lambda: out.wanted)  # noqa: B023 - awaited in the same turn
            await next_of(watch)
