"""The uplink's budget: what may go to the link now, and what waits. Pure: time is an argument."""

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

BACKLOG_S: Final = 0.1
"""How much of the budget is ever handed over ahead of the link."""

ROUNDING: Final = 1.0
"""Bytes by which sums of fractions may be off."""

S = TypeVar("S", bound=Hashable)
T = TypeVar("T")


@dataclass(slots=True)
class _Waiting(Generic[T]):
    """begins: the stream's place in the order, in bytes: those begin later that were given more so far."""

    item: T
    size: int
    begins: float


class Uplink(Generic[S, T]):
    """Lets through `bytes_per_s` bytes a second; of each stream the newest item waits.

    The backlog is what the link has been given and cannot have sent yet. An item goes when it fits into the backlog of
    BACKLOG_S; one that is larger than all of that goes alone, when the backlog is empty. Streams share the bytes
    equally (start-time fair queueing), so one with large items does not starve one with small ones, nor itself.
    Times are seconds of any clock that does not go back.
    """

    def __init__(self, bytes_per_s: float) -> None:
        self._rate = bytes_per_s
        self._backlog = 0.0
        self._at = 0.0
        self._waiting: dict[S, _Waiting[T]] = {}
        self._ends: dict[S, float] = {}
        self._now = 0.0

    def charge(self, size: int, now: float) -> None:
        """Count bytes that went without waiting."""
        self._drain(now)
        self._backlog += size

    def offer(self, stream: S, item: T, size: int) -> int:
        """Let an item wait; return how many older ones of its stream it replaced."""
        replaced = self._waiting.get(stream)
        begins = replaced.begins if replaced else max(self._now, self._ends.get(stream, 0))
        self._waiting[stream] = _Waiting(item, size, begins)
        return int(replaced is not None)

    def release(self, now: float) -> list[tuple[S, T]]:
        """Return what may go now, in this order."""
        self._drain(now)
        released = []
        while (stream := self._next()) is not None and self._wait_s(self._waiting[stream].size) <= 0:
            going = self._waiting.pop(stream)
            self._backlog += going.size
            self._now = going.begins
            self._ends[stream] = going.begins + going.size
            released.append((stream, going.item))
        self._forget()
        return released

    def next_release_s(self) -> float | None:
        """Return in how many seconds after the last `release` something may go; None while nothing waits."""
        stream = self._next()
        return None if stream is None else self._wait_s(self._waiting[stream].size)

    def discard(self, stream: S) -> int:
        """Forget a stream; return how many items of it waited."""
        self._ends.pop(stream, None)
        return int(self._waiting.pop(stream, None) is not None)

    @property
    def backlog(self) -> float:
        """Bytes given to the link that it cannot have sent by the last `release` or `charge`."""
        return self._backlog

    def _drain(self, now: float) -> None:
        self._backlog = max(0.0, self._backlog - self._rate * max(0.0, now - self._at))
        self._at = max(self._at, now)

    def _next(self) -> S | None:
        return min(self._waiting, key=lambda stream: self._waiting[stream].begins, default=None)

    def _wait_s(self, size: int) -> float:
        room = max(0.0, self._rate * BACKLOG_S - size)
        return (self._backlog - room - ROUNDING) / self._rate

    def _forget(self) -> None:
        """Streams that were given less than those served now have no claim to more than their share later."""
        self._ends = {stream: ends for stream, ends in self._ends.items() if ends > self._now}
