"""What is made at most every so often, once for all who ask."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Recent(Generic[T]):
    """Something that takes a while to make: whoever asks gets what is no older than `max_age_s`, or waits for it."""

    def __init__(self, make: Callable[[], Awaitable[T]], max_age_s: float) -> None:
        self._make = make
        self._max_age_s = max_age_s
        self._made: tuple[float, T] | None = None
        self._making = asyncio.Lock()

    async def get(self) -> T:
        """Return it."""
        async with self._making:
            if self._made is None or time.monotonic() - self._made[0] > self._max_age_s:
                self._made = (time.monotonic(), await self._make())
            return self._made[1]
