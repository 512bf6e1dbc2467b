"""A limit on how many frames are sent, by a clock of this machine alone. Pure: time is an argument."""

from typing import Final

SECOND_NS: Final = 1_000_000_000

BURST_S: Final = 0.5
"""Frames that were held up for so long on their way here may be sent as soon as they come."""


class TokenBucket:
    """Lets through `hz` frames a second, and at most BURST_S of them, and one, ahead of that."""

    def __init__(self, hz: float) -> None:
        self.hz = hz
        self._most = 1 + BURST_S * hz
        self._tokens = self._most
        self._last_ns: int | None = None

    def has_room(self, now_ns: int) -> bool:
        """Return whether a frame may be sent that is here now; a clock that is set back gives nothing."""
        since_ns = now_ns if self._last_ns is None else self._last_ns
        self._tokens = min(self._most, self._tokens + max(0, now_ns - since_ns) * self.hz / SECOND_NS)
        self._last_ns = now_ns
        return self._tokens >= 1

    def take(self) -> None:
        """Count a frame that is sent."""
        self._tokens -= 1
