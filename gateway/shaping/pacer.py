"""Hands payloads to the link as the uplink's budget allows."""

import asyncio
import time
from collections.abc import Callable, Hashable
from typing import Final

from gateway.shaping.uplink import Uplink

MBIT: Final = 1_000_000


class Pacer:
    """A budget of `mbit` megabits a second. To be used on the event loop's thread."""

    def __init__(self, mbit: float) -> None:
        self._uplink: Uplink[Hashable, tuple[bytes, Callable[[bytes], None]]] = Uplink(mbit * MBIT / 8)
        self._waits = asyncio.Event()

    def charge(self, size: int) -> None:
        """Count bytes that go without waiting."""
        self._uplink.charge(size, time.monotonic())

    def offer(self, stream: Hashable, payload: bytes, send: Callable[[bytes], None]) -> int:
        """Send a payload as soon as the budget allows; return how many older ones of its stream it replaced."""
        replaced = self._uplink.offer(stream, (payload, send), len(payload))
        self._release()
        return replaced

    def discard(self, stream: Hashable) -> int:
        """Forget what waits of a stream; return how many payloads that was."""
        return self._uplink.discard(stream)

    async def run(self) -> None:
        """Send what waits, for ever."""
        while True:
            delay_s = self._uplink.next_release_s()
            if delay_s is None:
                self._waits.clear()
                await self._waits.wait()
            else:
                await asyncio.sleep(delay_s)
                self._release()

    def _release(self) -> None:
        for _, (payload, send) in self._uplink.release(time.monotonic()):
            send(payload)
        if self._uplink.next_release_s() is not None:
            self._waits.set()
