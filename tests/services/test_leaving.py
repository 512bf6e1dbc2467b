"""How a worker's process is left, on the real bus."""

import asyncio
import threading
import time
from concurrent.futures import Executor
from types import ModuleType
from typing import Any

import pytest

from bus import Bus
from services.cloud import process as cloud
from services.cloud.settings import CloudSettings
from services.distance import process as distance
from services.distance.settings import DistanceSettings
from services.toolbox.demo.children import free_ports

LONG_S = 8.0


@pytest.mark.parametrize(
    ("process", "worker", "kind"),
    [(cloud, "CloudWorker", CloudSettings), (distance, "DistanceWorker", DistanceSettings)],
)
async def test_leaving_waits_for_nothing_that_is_being_measured(
    process: ModuleType, worker: str, kind: type[CloudSettings | DistanceSettings], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, may_end = threading.Event(), threading.Event()

    class Busy:
        """A worker whose thread is in the middle of something long."""

        def __init__(self, bus: Bus, settings: Any, executor: Executor) -> None:
            del bus, settings
            executor.submit(self._work)

        def _work(self) -> None:
            begun.set()
            may_end.wait(LONG_S)

        async def run(self) -> None:
            await asyncio.Event().wait()

    monkeypatch.setattr(process, worker, Busy)
    listen = [f"tcp/127.0.0.1:{free_ports(1)}"]
    settings = kind.model_validate({"mode": "router", "listen": listen, "connect": []})
    running = asyncio.create_task(process.run(settings))
    assert await asyncio.to_thread(begun.wait, 60)
    since_s = time.monotonic()
    running.cancel()
    await asyncio.wait([running])
    took_s = time.monotonic() - since_s
    may_end.set()
    assert took_s < LONG_S / 2
