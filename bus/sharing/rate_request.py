"""Requests a frame rate from a camera's gateway."""

import asyncio
import time
from contextlib import suppress
from typing import Final

from bus.api import Bus, QoS
from schemas import codec, consumer_keys
from schemas.budget import LEAST_HZ, MOST_WAIT_S, RateBudget
from schemas.keys import StreamKey

REPEAT_S: Final = 5.0
"""Interval at which a limit is repeated: a gateway forgets it with the link on which it came."""


class RateRequest:
    """The frame rate requested from one camera's gateway; none until there is a limit. Quick changes are merged.

    hz: frames a second, None for all of them. from_ns: when the next one is wanted, in nanoseconds since the epoch.
    """

    def __init__(self) -> None:
        self.hz: float | None = None
        self.from_ns = 0
        self._wait_s = 0.0
        self._changed = asyncio.Event()

    def ask(self, hz: float | None, wait_s: float = 0.0) -> None:
        """Request at most `hz` frames a second (None: all of them), the next one after `wait_s` seconds."""
        if hz is None and self.hz is None:
            return
        self.hz = None if hz is None else max(LEAST_HZ, hz)
        self._wait_s = min(MOST_WAIT_S, wait_s)
        self.from_ns = time.time_ns() + round(self._wait_s * 1e9)
        self._changed.set()

    async def tell(self, bus: Bus, frames: StreamKey, consumer: str) -> None:
        """Publish the consumer's request for a stream on each change, and a limit every REPEAT_S, forever.

        A gateway that comes gets it at once: then there is demand for it.
        """
        if self.hz is None:
            self._changed.clear()
            await self._changed.wait()
        key = consumer_keys.budget(frames.camera, consumer)
        async with bus.publisher(
            key, QoS.STATUS, encoding=codec.encoding(RateBudget), kept=0, on_demand=self._repeat
        ) as publisher:
            while True:
                self._changed.clear()
                if publisher.wanted:
                    if self.from_ns <= time.time_ns():
                        self._wait_s = 0.0  # it was while nobody heard it
                    publisher.put(codec.encode(self._budget(frames, consumer)))
                    self._wait_s = 0.0
                with suppress(TimeoutError):
                    async with asyncio.timeout(None if self.hz is None else REPEAT_S):
                        await self._changed.wait()

    def _repeat(self, wanted: bool) -> None:  # noqa: FBT001 - the bus calls it so
        if wanted:
            self._changed.set()

    def _budget(self, frames: StreamKey, consumer: str) -> RateBudget:
        return RateBudget(
            robot=frames.camera.robot,
            camera=frames.camera.camera,
            consumer=consumer,
            stream=frames.stream,
            hz=self.hz,
            wait_s=self._wait_s,
        )
