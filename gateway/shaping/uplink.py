"""The uplink's budget: what may go to the link now, and what waits. Pure: time is an argument."""

from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from math import inf
from typing import Final, Generic, TypeVar

BACKLOG_S: Final = 0.1
"""How much of the budget is ever handed over ahead of the link."""

ROUNDING: Final = 1.0
"""Bytes by which sums of fractions may be off."""

S = TypeVar("S", bound=Hashable)
T = TypeVar("T")


@dataclass(slots=True, eq=False)
class Moment:
    """What several streams have items of that are of use together only.

    of: whose moment it is. number: later ones of the same have higher ones. begun: whether an item of it has gone.
    """

    of: Hashable
    number: int
    begun: bool = False


@dataclass(slots=True)
class _Waiting(Generic[T]):
    """begins: the stream's place in the order, in bytes: those begin later that were given more so far."""

    item: T
    size: int
    begins: float
    moment: Moment | None


class Uplink(Generic[S, T]):
    """Lets through `bytes_per_s` bytes a second; of each stream the newest item waits.

    The backlog is what the link has been given and cannot have sent yet. An item goes when it fits into the backlog of
    BACKLOG_S; one that is larger than all of that goes alone, when the backlog is empty. Streams share the bytes
    equally (start-time fair queueing), so one with large items does not starve one with small ones, nor itself.
    Times are seconds of any clock that does not go back.

    An item of a moment that has begun is not replaced by one of a moment that has not, and goes before any such; the
    next moment to begin is the newest. So streams whose items come in other orders send those of the same moments.
    """

    def __init__(self, bytes_per_s: float) -> None:
        self._rate = bytes_per_s
        self._backlog = 0.0
        self._at = 0.0
        self._waiting: dict[tuple[S, bool], _Waiting[T]] = {}
        self._begun: dict[Hashable, int] = {}
        self._lost: list[T] = []
        self._ends: dict[S, float] = {}
        self._now = 0.0

    def charge(self, size: int, now: float) -> None:
        """Count bytes that went without waiting."""
        self._drain(now)
        self._backlog += size

    def offer(self, stream: S, item: T, size: int, moment: Moment | None = None) -> int:
        """Let an item wait; return how many of its stream that costs: an older one, or itself where it is too late."""
        begun = moment is not None and moment.begun
        if moment is not None and not begun and moment.number < self._begun.get(moment.of, moment.number):
            return 1
        replaced = self._waiting.get((stream, begun))
        begins = replaced.begins if replaced else max(self._now, self._ends.get(stream, 0))
        self._waiting[stream, begun] = _Waiting(item, size, begins, moment)
        return int(replaced is not None)

    def release(self, now: float) -> list[tuple[S, T]]:
        """Return what may go now, in this order."""
        self._drain(now)
        released = []
        while (place := self._next()) is not None and self._wait_s(self._waiting[place].size) <= 0:
            going = self._waiting.pop(place)
            self._backlog += going.size
            self._now = going.begins
            self._ends[place[0]] = going.begins + going.size
            released.append((place[0], going.item))
            if going.moment is not None and not going.moment.begun:
                self._begin(going.moment)
        self._forget()
        return released

    def lost(self) -> Iterator[T]:
        """Take what will never go since a later moment has begun."""
        while self._lost:
            yield self._lost.pop(0)

    def next_release_s(self) -> float | None:
        """Return in how many seconds after the last `release` something may go; None while nothing waits."""
        place = self._next()
        return None if place is None else self._wait_s(self._waiting[place].size)

    def discard(self, stream: S) -> int:
        """Forget a stream; return how many items of it waited."""
        self._ends.pop(stream, None)
        return sum(self._waiting.pop((stream, begun), None) is not None for begun in (True, False))

    @property
    def backlog(self) -> float:
        """Bytes given to the link that it cannot have sent by the last `release` or `charge`."""
        return self._backlog

    def _drain(self, now: float) -> None:
        self._backlog = max(0.0, self._backlog - self._rate * max(0.0, now - self._at))
        self._at = max(self._at, now)

    def _next(self) -> tuple[S, bool] | None:
        newest: dict[Hashable, float] = {}
        for (_, begun), waits in self._waiting.items():
            if waits.moment is not None:
                number = inf if begun else waits.moment.number
                newest[waits.moment.of] = max(number, newest.get(waits.moment.of, number))
        eligible = (
            (stream, begun)
            for (stream, begun), waits in self._waiting.items()
            if begun or waits.moment is None or waits.moment.number == newest[waits.moment.of]
        )
        return min(eligible, key=lambda place: self._waiting[place].begins, default=None)

    def _begin(self, moment: Moment) -> None:
        """What waits of the moment is not replaced from now on, what waits of earlier ones is lost."""
        moment.begun = True
        self._begun[moment.of] = moment.number
        for (stream, begun), waits in list(self._waiting.items()):
            if begun or waits.moment is None or waits.moment.of != moment.of:
                continue
            if waits.moment is moment:
                self._waiting[stream, True] = self._waiting.pop((stream, False))
            elif waits.moment.number < moment.number:
                self._lost.append(self._waiting.pop((stream, False)).item)

    def _wait_s(self, size: int) -> float:
        room = max(0.0, self._rate * BACKLOG_S - size)
        return (self._backlog - room - ROUNDING) / self._rate

    def _forget(self) -> None:
        """Streams that were given less than those served now have no claim to more than their share later."""
        self._ends = {stream: ends for stream, ends in self._ends.items() if ends > self._now}
