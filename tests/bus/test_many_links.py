"""Thousands of robots and workers at one router."""

import asyncio
import sys
from contextlib import AsyncExitStack
from typing import Final

import pytest

from bus import QUEUE, BusSettings, open_bus, zenoh_bus
from bus.session.link_use import OTHER_FILES
from tests.bus.sessions import ROOT, client, running
from tests.contract.conftest import free_endpoint
from tests.waiting import until

SESSIONS: Final = 1_500
PROCESSES: Final = 3

CLIENTS: Final = """
import json, os, sys
import zenoh
from bus import BusSettings
from bus.session.config import session_config

config = json.dumps(session_config(BusSettings(connect=[sys.argv[1]], shared_memory=False)))
sessions = [zenoh.open(zenoh.Config.from_json5(config)) for _ in range(int(sys.argv[2]))]
print("ready", flush=True)
sys.stdin.read()
for session in sessions:
    assert len(session.info.links()) == 1
sessions[-1].put("last", b"here")
sessions[-1].close()
os._exit(0)  # closing all of them one by one takes a while
"""


@pytest.mark.timeout(120)
async def test_a_router_has_more_links_than_zenohs_default_allows(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zenoh_bus, "CLOSE_DEADLINE_S", 30.0)  # a busy machine closes late, and says so
    endpoint = free_endpoint()
    settings = BusSettings(mode="router", listen=[endpoint], shared_memory=False)
    async with open_bus(settings) as bus, bus.subscribe("last", QUEUE(PROCESSES)) as last:
        assert bus.links.limit > SESSIONS
        clients = [await _started(endpoint, SESSIONS // PROCESSES) for _ in range(PROCESSES)]
        try:
            for each in clients:
                assert each.stdout is not None
                assert await each.stdout.readline() == b"ready\n"
            await until(lambda: bus.links.count == SESSIONS)
            for each in clients:
                await each.communicate(b"")  # closes what it waits for
                assert each.returncode == 0
            assert [(await anext(last)).payload for _ in clients] == [b"here"] * PROCESSES
            await until(lambda: bus.links.count == 0)
        finally:
            for each in clients:
                if each.returncode is None:
                    each.kill()
                    await each.communicate()
    assert [record.message for record in caplog.records if record.levelname == "WARNING"] == []


async def _started(endpoint: str, sessions: int) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", CLIENTS, endpoint, str(sessions)),
        cwd=ROOT,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
    )


SMALL_ROUTER: Final = """
import asyncio, resource, sys
from bus import BusSettings, open_bus

resource.setrlimit(resource.RLIMIT_NOFILE, (int(sys.argv[2]) // 2, int(sys.argv[2])))

async def main() -> None:
    async with open_bus(BusSettings(mode="router", listen=[sys.argv[1]], shared_memory=False)) as bus:
        print("ready", flush=True)
        while not bus.links.problem:
            await asyncio.sleep(0.05)
        print(bus.links.problem, flush=True)
        await asyncio.Event().wait()

asyncio.run(main())
"""


async def test_where_few_files_may_be_open_it_is_said_before_the_last_link_is_taken() -> None:
    links, endpoint = 10, free_endpoint()
    async with running(SMALL_ROUTER, endpoint, str(OTHER_FILES + links)) as router, AsyncExitStack() as stack:
        sessions = [await stack.enter_async_context(open_bus(client(endpoint))) for _ in range(links - 1)]
        assert router.stdout is not None
        assert (await router.stdout.readline()).startswith(b"9 of at most 10 links are in use, further ones")
        sessions += [await stack.enter_async_context(open_bus(client(endpoint))) for _ in range(2)]
        assert [bool(each.link_problem) for each in sessions] == [False] * links + [True]
