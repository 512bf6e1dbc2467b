"""What a process says of itself while it works."""

import asyncio
from collections.abc import Callable
from typing import Final, TypeVar

from bus.api import Bus, QoS
from schemas import codec
from schemas.status import GatewayStatus, WorkerStatus

STATUS_PERIOD_S: Final = 1.0

S = TypeVar("S", GatewayStatus, WorkerStatus)


async def report(bus: Bus, key: str, kind: type[S], status: Callable[[], S]) -> None:
    """Publish a status every STATUS_PERIOD_S until cancelled, and then once more."""
    async with bus.publisher(key, QoS.STATUS, encoding=codec.encoding(kind)) as publisher:
        try:
            while True:
                publisher.put(codec.encode(status()))
                await asyncio.sleep(STATUS_PERIOD_S)
        finally:
            publisher.put(codec.encode(status()))
