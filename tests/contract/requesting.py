"""Requests under test, and a server that hangs."""

import asyncio
from typing import Final

from bus import (
    Bus,
    NotServedError,
    Reply,
    Request,
)
from tests.waiting import PATIENCE_S

KEY: Final = "fleet/r1/clock"


async def ask(bus: Bus, payload: bytes | bytearray = b"", *, key: str = KEY) -> bytes:
    """Ask until somebody serves the key: that somebody does travels to us too."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            try:
                return (await bus.request(key, payload, timeout_s=PATIENCE_S)).payload
            except NotServedError:
                await asyncio.sleep(0.01)


class Hanging:
    """A handler that waits until it is released, and says how often it was called and cancelled."""

    def __init__(self) -> None:
        self.begun: list[bytes] = []
        self.cancelled = 0
        self.release = asyncio.Event()

    async def __call__(self, request: Request) -> Reply:
        self.begun.append(request.payload)
        try:
            await self.release.wait()
        except asyncio.CancelledError:
            self.cancelled += 1
            raise
        return Reply(request.payload)


async def until_served(bus: Bus, key: str, hanging: Hanging) -> None:
    """Wait until a request reaches the handler; it is answered then."""
    hanging.release.set()
    await ask(bus, key=key)
    hanging.release.clear()
