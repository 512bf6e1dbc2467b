"""Requests where only real sessions show anything: servers that hang, die and go, other programs, cancellation."""

import asyncio
import json
import logging
import signal
from contextlib import AsyncExitStack, suppress
from typing import Final

import pytest
import zenoh

from bus import (
    MAX_REQUEST_BYTES,
    Bus,
    BusSettings,
    Handler,
    NotServedError,
    Reply,
    Request,
    RequestTimeoutError,
    open_bus,
)
from bus.zenoh_bus import ZenohBus
from tests.bus.sessions import LEASE_S, ROUTER, bus_threads, client, never, router, running
from tests.contract.conftest import free_endpoint
from tests.waiting import PATIENCE_S, until

SERVER: Final = """
import asyncio, sys
from bus import BusSettings, Reply, Request, open_bus

async def handler(request: Request) -> Reply:
    if request.payload:
        print("asked", flush=True)
        await asyncio.Event().wait()
    return Reply(b"here")

async def main() -> None:
    settings = BusSettings(connect=[sys.argv[1]], lease_s=float(sys.argv[2]))
    async with open_bus(settings) as bus, bus.serve("clock", handler):
        print("ready", flush=True)
        await asyncio.Event().wait()

asyncio.run(main())
"""


HANGING_LEASE_S: Final = 4 * LEASE_S
"""How long a server may hang: much longer than it takes to stop one and ask it, on a busy machine too."""


async def test_requests_end_when_their_server_hangs_or_dies(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, logger="asyncio")
    endpoint = free_endpoint()
    lease = {"lease_s": HANGING_LEASE_S}
    async with (
        open_bus(router(endpoint).model_copy(update=lease)),
        open_bus(client(endpoint).model_copy(update=lease)) as bus,
        running(SERVER, endpoint, str(HANGING_LEASE_S)) as server,
    ):
        await until_answered(bus)
        server.send_signal(signal.SIGSTOP)
        with pytest.raises(RequestTimeoutError):
            await bus.request("clock", timeout_s=0.3)
        with pytest.raises(NotServedError):  # after the lease
            await bus.request("clock", timeout_s=PATIENCE_S)
        server.send_signal(signal.SIGCONT)
        await until_answered(bus)
        asking = asyncio.create_task(bus.request("clock", b"wait", timeout_s=PATIENCE_S))
        assert server.stdout is not None
        assert await server.stdout.readline() == b"asked\n"
        server.kill()
        with pytest.raises(NotServedError, match="or it left before answering"):
            await asking
    said = [record.getMessage() for record in caplog.records]
    assert [each for each in said if not each.startswith("Executing ")] == []  # which tells of a busy machine


async def until_answered(bus: Bus) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            with suppress(NotServedError):
                assert await bus.request("clock", timeout_s=PATIENCE_S) == Reply(b"here")
                return
            await asyncio.sleep(0.05)


async def test_each_request_is_answered_by_one_of_several_processes_and_by_the_next_when_that_is_gone() -> None:
    endpoint = free_endpoint()
    answered: list[str] = []

    def named(name: str) -> Handler:
        async def handler(_: Request) -> Reply:
            answered.append(name)
            return Reply(b"here")

        return handler

    async with (
        open_bus(router(endpoint)),
        open_bus(client(endpoint)) as asker,
        open_bus(client(endpoint)) as one,
        open_bus(client(endpoint)) as two,
        AsyncExitStack() as first,
    ):
        serving = {"one": one, "two": two}
        stacks = {name: await first.enter_async_context(AsyncExitStack()) for name in serving}
        for name, bus in serving.items():
            await stacks[name].enter_async_context(bus.serve("clock", named(name)))
        await until_answered(asker)
        answered.clear()
        for _ in range(20):
            await asker.request("clock", timeout_s=PATIENCE_S)
        assert len(answered) == 20
        gone = answered[-1]
        await stacks[gone].aclose()
        await until_answered(asker)
        assert answered[-1] == ({"one", "two"} - {gone}).pop()


async def test_a_request_cancelled_at_any_await_is_forgotten() -> None:
    async def slow(_: Request) -> Reply:
        await asyncio.sleep(0.001)
        return Reply(b"")

    async with open_bus(router(free_endpoint())) as bus, bus.serve("clock", slow, waiting=100):
        assert isinstance(bus, ZenohBus)
        for turns in range(8):
            task = asyncio.create_task(bus.request("clock", timeout_s=PATIENCE_S))
            for _ in range(turns):
                await asyncio.sleep(0)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            assert bus._asking._askings == set()
        assert await bus.request("clock", timeout_s=PATIENCE_S) == Reply(b"")


async def test_a_request_without_a_router_says_so_and_through_a_hanging_one_times_out() -> None:
    endpoint = free_endpoint()
    async with open_bus(client(endpoint)) as bus:
        with pytest.raises(NotServedError, match=f"there is no router at {endpoint} yet"):
            await bus.request("clock", timeout_s=PATIENCE_S)
    async with running(ROUTER, endpoint, "30") as hub:
        settings = BusSettings(connect=[endpoint], lease_s=30, shared_memory=False)
        async with open_bus(settings) as bus, bus.serve("clock", never):
            hub.send_signal(signal.SIGSTOP)
            for size in (0, 1_000_000):
                with pytest.raises(RequestTimeoutError):
                    await bus.request("other", bytes(size), timeout_s=0.2)
    await until(lambda: bus_threads() == [])


async def test_other_programs_may_ask_and_are_told_what_they_do_wrong() -> None:
    endpoint = free_endpoint()

    async def handler(request: Request) -> Reply:
        return Reply(request.payload)

    def ask(selector: str, payload: bytes | None = None) -> list[bytes | str]:
        replies = stranger.get(selector, target=zenoh.QueryTarget.ALL, payload=payload, timeout=PATIENCE_S)
        return [
            reply.ok.payload.to_bytes() if reply.ok else reply.err.payload.to_string() if reply.err else ""
            for reply in replies
        ]

    settings = {"mode": "client", "connect": {"endpoints": [endpoint]}}
    async with (
        open_bus(router(endpoint)) as bus,
        bus.serve("fleet/r1/clock", handler),
        bus.serve("fleet/r1/service/**", handler),
    ):
        stranger = await asyncio.to_thread(zenoh.open, zenoh.Config.from_json5(json.dumps(settings)))
        try:
            assert await asyncio.to_thread(ask, "fleet/r1/clock") == [b""]
            assert await asyncio.to_thread(ask, "fleet/r1/clock?timeout_ms=soon", b"x") == [b"x"]
            assert await asyncio.to_thread(ask, "fleet/*/clock", b"x") == [b"x"]
            too_large = await asyncio.to_thread(ask, "fleet/r1/clock", bytes(MAX_REQUEST_BYTES + 1))
            assert too_large == ["a request of 16777217 bytes, at most 16777216 are read"]
            assert await asyncio.to_thread(ask, "fleet/*/service/*") == [
                "fleet/*/service/* has wildcards; request a single key"
            ]
        finally:
            await asyncio.to_thread(stranger.close)
