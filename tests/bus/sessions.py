"""Real sessions: where they listen, processes that have one, and what is left of them."""

import asyncio
import os
import signal
import sys
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Final

from bus import BusSettings, Publisher, Reply, Request
from tests.waiting import PATIENCE_S

ROOT: Final = Path(__file__).parents[2]
LEASE_S: Final = 1.0

ROUTER: Final = """
import asyncio, sys
from bus import BusSettings, Reply, Request, open_bus

async def main() -> None:
    async with open_bus(BusSettings(mode="router", listen=[sys.argv[1]], lease_s=float(sys.argv[2]))):
        print("ready", flush=True)
        await asyncio.Event().wait()

asyncio.run(main())
"""


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
            with suppress(ProcessLookupError):  # its own methods take a dead one from under asyncio, which says so
                os.kill(process.pid, signal.SIGCONT)
                os.kill(process.pid, signal.SIGKILL)
        await process.communicate()


def bus_threads() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("bus-")]


async def answer(request: Request) -> Reply:
    return Reply(request.payload)


async def never(_: Request) -> Reply:
    raise AssertionError("nobody asks")


class Numbering:
    """Publishes numbers from 0 on. count: how many it published."""

    def __init__(self, publisher: Publisher) -> None:
        self.count = 0
        self._publisher = publisher
        self._running = asyncio.create_task(self._run())

    @property
    def sent(self) -> list[bytes]:
        """Everything that it published, in order."""
        return [b"%d" % each for each in range(self.count)]

    def end(self) -> None:
        self._running.cancel()

    async def _run(self) -> None:
        while True:
            self._publisher.put(b"%d" % self.count)
            self.count += 1
            await asyncio.sleep(0.002)
