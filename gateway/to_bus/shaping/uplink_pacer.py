"""Hands payloads to the link as the uplink's budget allows."""

import asyncio
import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Final

from bus import Payload
from gateway.to_bus.shaping.uplink import Moment, Uplink

MBIT: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class _Offered:
    """A payload, the function that sends it, and the one called if it is dropped."""

    payload: Payload
    send: Callable[[Payload], None]
    lose: Callable[[], None]


class Pacer:
    """Sends payloads within a budget of `mbit` megabits a second. Event loop only."""

    def __init__(self, mbit: float) -> None:
        self._uplink: Uplink[Hashable, _Offered] = Uplink(mbit * MBIT / 8)
        self._waits = asyncio.Event()

    def charge(self, size: int) -> None:
        """Count bytes that bypass the budget."""
        self._uplink.charge(size, time.monotonic())

    def offer(
        self,
        stream: Hashable,
        payload: Payload,
        send: Callable[[Payload], None],
        *,
        moment: Moment | None = None,
        lose: Callable[[], None] = lambda: None,
    ) -> int:
        """Send a payload as soon as the budget allows; return the number of its stream's payloads dropped for it.

        lose: called when a payload that waits will not be sent, since other streams have begun a later moment.
        """
        lost = self._uplink.offer(stream, _Offered(payload, send, lose), len(payload), moment)
        self._release()
        return lost

    def discard(self, stream: Hashable) -> int:
        """Drop a stream's waiting payloads; return their number."""
        return self._uplink.discard(stream)

    def forget_moments(self, of: Hashable) -> None:
        """Forget an owner that has no further moments."""
        self._uplink.forget_moments(of)

    async def run(self) -> None:
        """Send waiting payloads, forever."""
        while True:
            delay_s = self._uplink.next_release_s()
            if delay_s is None:
                self._waits.clear()
                await self._waits.wait()
            else:
                await asyncio.sleep(delay_s)
                self._release()

    def _release(self) -> None:
        for _, offered in self._uplink.release(time.monotonic()):
            offered.send(offered.payload)
        for offered in self._uplink.lost():
            offered.lose()
        if self._uplink.next_release_s() is not None:
            self._waits.set()
