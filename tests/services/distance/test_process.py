"""How a worker's process is left, on the real bus."""

import asyncio
import threading
import time
from concurrent.futures import Executor

import pytest

from bus import Bus
from services.distance import process
from services.distance.settings import DistanceSettings
from services.toolbox.demo.ports import free_ports

LONG_S = 8.0


class Busy:
    """A worker whose thread is in the middle of something long."""

    begun = threading.Event()
    may_end = threading.Event()

    def __init__(self, bus: Bus, settings: DistanceSettings, executor: Executor) -> None:
        del bus, settings
        executor.submit(self._work)

    def _work(self) -> None:
        self.begun.set()
        self.may_end.wait(LONG_S)

    async def run(self) -> None:
        await asyncio.Event().wait()


async def test_leaving_waits_for_no_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "Worker", Busy)
    listen = [f"tcp/127.0.0.1:{free_ports(1)}"]
    settings = DistanceSettings.model_validate({"mode": "router", "listen": listen, "connect": []})
    running = asyncio.create_task(process.run(settings))
    assert await asyncio.to_thread(Busy.begun.wait, 60)
    since_s = time.monotonic()
    running.cancel()
    await asyncio.wait([running])
    took_s = time.monotonic() - since_s
    Busy.may_end.set()
    assert took_s < LONG_S / 2
