"""Periodic status messages of a process, and the version in them."""

import asyncio
import logging
import math
from collections.abc import Callable
from importlib.metadata import version
from typing import Final, TypeVar

import msgspec

from bus.api import Bus, QoS
from schemas import codec
from schemas.status import GatewayStatus, WorkerStatus
from schemas.world import SiteStatus

log = logging.getLogger(__name__)

STATUS_PERIOD_S: Final = 1.0

COMPLAIN_S: Final = 30.0
"""Shortest interval between log messages on statuses that cannot be sent."""

S = TypeVar("S", GatewayStatus, WorkerStatus, SiteStatus)


async def report(bus: Bus, key: str, kind: type[S], status: Callable[[], S]) -> None:
    """Publish a status every STATUS_PERIOD_S until cancelled, and a final one then.

    One that cannot be encoded is left out: the process does its work without it.
    """
    async with bus.publisher(key, QoS.STATUS, encoding=codec.encoding(kind)) as publisher:
        complained_s = -math.inf

        def put() -> None:
            nonlocal complained_s
            try:
                payload = codec.encode(status())
            except (msgspec.MsgspecError, OverflowError, UnicodeError) as error:
                now_s = asyncio.get_running_loop().time()
                if now_s - complained_s >= COMPLAIN_S:
                    complained_s = now_s
                    log.error("%s: status not sent: %s", key, error)  # noqa: TRY400 - no stack says more
            else:
                publisher.put(payload)

        try:
            while True:
                put()
                await asyncio.sleep(STATUS_PERIOD_S)
        finally:
            put()


VERSION: Final = version("fleetsight")
