"""A value that is made once for all who ask at about the same time."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Generic, TypeVar

V = TypeVar("V")


class CachedValue(Generic[V]):
    """A value that takes a while to make: callers get one no older than `max_age_s`, or wait for it.

    share: of the time, that making it may take. A value that takes less is made again before `max_age_s`.
    """

    def __init__(self, make: Callable[[], Awaitable[V]], max_age_s: float, *, share: float = 0.0) -> None:
        self._make = make
        self._max_age_s = max_age_s
        self._share = share
        self._took_s = 0.0
        self._made: tuple[float, V] | None = None
        self._failed: tuple[float, Exception] | None = None
        self._making = asyncio.Lock()

    async def get(self) -> V:
        """Return the value; an error in making it goes to all who waited meanwhile, so that none waits twice."""
        asked_s = time.monotonic()
        async with self._making:
            if self._failed is not None and asked_s <= self._failed[0]:
                raise self._failed[1]
            began_s = time.monotonic()
            if self._made is None or self._is_old(began_s - self._made[0]):
                try:
                    self._made = (began_s, await self._make())
                except Exception as error:
                    self._failed = (time.monotonic(), error)
                    raise
                self._took_s = time.monotonic() - began_s
            return self._made[1]

    def _is_old(self, age_s: float) -> bool:
        return age_s > self._max_age_s or self._took_s < self._share * age_s
