"""How long to wait before the next attempt."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from random import Random


class Backoff:
    """Doubles from `first` to `last` seconds, each delay jittered down by up to half."""

    def __init__(self, rng: Random, *, first: float = 0.1, last: float = 5.0) -> None:
        self._rng = rng
        self._first = first
        self._last = last
        self._next = first

    def reset(self) -> None:
        self._next = self._first

    def next_delay(self) -> float:
        """Return the next delay in seconds."""
        delay = self._next * self._rng.uniform(0.5, 1.0)
        self._next = min(self._next * 2, self._last)
        return delay
