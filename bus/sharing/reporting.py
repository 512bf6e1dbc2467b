"""What every worker says while it works: how it does, and that a camera that nobody wants is taken over."""

import asyncio
from collections.abc import Callable
from typing import Final

from bus.api import Bus, QoS
from bus.shared_demand import SharedDemand
from schemas import codec, worker_keys
from schemas.status import WorkerStatus

STATUS_PERIOD_S: Final = 1.0

UNWANTED_S: Final = 0.2
"""A camera whose results nobody has wanted for so long since it was taken over is taken over."""


async def report(bus: Bus, service: str, worker: str, status: Callable[[], WorkerStatus]) -> None:
    """Publish a worker's status every STATUS_PERIOD_S until cancelled, and then once more."""
    key = worker_keys.worker_status(service, worker)
    async with bus.publisher(key, QoS.STATUS, encoding=codec.encoding(WorkerStatus)) as publisher:
        try:
            while True:
                publisher.put(codec.encode(status()))
                await asyncio.sleep(STATUS_PERIOD_S)
        finally:
            publisher.put(codec.encode(status()))


async def say_unwanted(demand: SharedDemand, took_over: Callable[[], None]) -> None:
    """Say that a camera is taken over once nobody wants its results: none will come that could say so."""
    await asyncio.sleep(UNWANTED_S)
    await demand.until(wanted=False)
    took_over()
