"""A token bucket that limits the frame rate. Pure: time is an argument."""

from typing import Final

SECOND_NS: Final = 1_000_000_000

BURST_S: Final = 0.5
"""Longest delay in transit after which delayed frames may still be sent at once."""


class TokenBucket:
    """Lets through `hz` frames a second, with a burst of BURST_S of them plus one."""

    def __init__(self, hz: float) -> None:
        self.hz = hz
        self._most = 1 + BURST_S * hz
        self._tokens = self._most
        self._last_ns: int | None = None

    def has_room(self, now_ns: int) -> bool:
        """Return whether a frame that arrives now may be sent; a clock set back adds no tokens."""
        since_ns = now_ns if self._last_ns is None else self._last_ns
        self._tokens = min(self._most, self._tokens + max(0, now_ns - since_ns) * self.hz / SECOND_NS)
        self._last_ns = now_ns
        return self._tokens >= 1

    def take(self) -> None:
        """Count a frame that is sent."""
        self._tokens -= 1
