"""Schedules messages under the uplink's budget. Pure: time is an argument."""

from collections import Counter
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

BACKLOG_S: Final = 0.1
"""Largest backlog of the link, in seconds of the budget."""

HELD_BYTES: Final = 640 << 10
"""Most bytes that a link buffers of unpaced messages: two batches of 64 KiB in Zenoh, half a MiB in the system.

The link drops messages beyond that, so they take none of the budget later.
"""

ROUNDING: Final = 1.0
"""Tolerance for rounding in sums of fractions, in bytes."""

S = TypeVar("S", bound=Hashable)
T = TypeVar("T")


@dataclass(slots=True, eq=False)
class Moment:
    """A moment of which several streams have items that are useful only together.

    of: the moment's owner. number: grows with each of an owner's moments. begun: whether an item of it was sent.
    """

    of: Hashable
    number: int
    begun: bool = False


@dataclass(slots=True)
class _Waiting(Generic[T]):
    """A waiting item. since: the stream's place in the order, in bytes, when it began to wait."""

    item: T
    size: int
    since: float


class Uplink(Generic[S, T]):
    """Lets through `bytes_per_s` bytes a second; the newest item of each stream waits.

    The backlog is what the link was given and cannot have sent yet. An item goes when it fits into the backlog of
    BACKLOG_S; one that is larger than all of that goes alone, when the backlog is empty. Streams share the bytes
    equally (start-time fair queueing), so one with large items does not starve one with small ones, nor itself.
    Times are seconds of any clock that does not go back.

    An item of a moment that has begun is not replaced by one of a moment that has not, and goes before any such. The
    next moment to begin is the one of which the most streams have an item that waits, the newest of several; its items
    are not replaced by those of moments with fewer. So streams whose items come in other orders, or more rarely, send
    those of the same moments.
    """

    def __init__(self, bytes_per_s: float) -> None:
        self._rate = bytes_per_s
        self._backlog = 0.0
        self._charged = 0.0  # the unpaced part of the backlog, which the link sends first
        self._at = 0.0
        self._waiting: dict[tuple[S, Moment | None], _Waiting[T]] = {}
        self._begun: dict[Hashable, int] = {}
        self._lost: list[T] = []
        self._ends: dict[S, float] = {}
        self._now = 0.0

    def charge(self, size: int, now: float) -> None:
        """Count bytes that bypass the budget, as far as the link can buffer them."""
        self._drain(now)
        counted = max(0.0, min(size, HELD_BYTES - self._charged))
        self._charged += counted
        self._backlog += counted

    def offer(self, stream: S, item: T, size: int, moment: Moment | None = None) -> int:
        """Queue an item; return the number of items of its stream dropped: older ones, or itself if it is too late."""
        if moment is not None and not moment.begun and moment.number < self._begun.get(moment.of, moment.number):
            return 1
        since = min(
            (waits.since for (other, _), waits in self._waiting.items() if other == stream),
            default=max(self._now, self._ends.get(stream, 0.0)),
        )
        replaced = int((stream, moment) in self._waiting)
        self._waiting[stream, moment] = _Waiting(item, size, since)
        return replaced + self._replace(stream, moment)

    def release(self, now: float) -> list[tuple[S, T]]:
        """Return the items that may be sent now, in order."""
        self._drain(now)
        released = []
        while (place := self._next()) is not None and self._wait_s(self._waiting[place].size) <= 0:
            self._now = max(self._now, self._begins(place))
            going = self._waiting.pop(place)
            self._backlog += going.size
            stream, moment = place
            self._ends[stream] = self._now + going.size
            released.append((stream, going.item))
            if moment is not None and not moment.begun:
                self._begin(moment)
        self._forget()
        return released

    def lost(self) -> Iterator[T]:
        """Yield and remove items that will never be sent, since a later moment has begun."""
        while self._lost:
            yield self._lost.pop(0)

    def next_release_s(self) -> float | None:
        """Return the seconds from the last `release` until an item may be sent; None while nothing waits."""
        place = self._next()
        return None if place is None else self._wait_s(self._waiting[place].size)

    def discard(self, stream: S) -> int:
        """Forget a stream; return the number of its waiting items."""
        self._ends.pop(stream, None)
        places = [place for place in self._waiting if place[0] == stream]
        for place in places:
            del self._waiting[place]
        return len(places)

    def forget_moments(self, of: Hashable) -> None:
        """Forget an owner's begun moments; call when no item of its moments waits."""
        self._begun.pop(of, None)

    def _drain(self, now: float) -> None:
        sent = self._rate * max(0.0, now - self._at)
        self._backlog = max(0.0, self._backlog - sent)
        self._charged = max(0.0, self._charged - sent)
        self._at = max(self._at, now)

    def _next(self) -> tuple[S, Moment | None] | None:
        company = Counter(moment for _, moment in self._waiting if moment is not None)
        first: dict[Hashable, tuple[bool, int, int]] = {}
        for moment, streams in company.items():
            first[moment.of] = max(_rank(moment, streams), first.get(moment.of, (False, 0, 0)))
        eligible = (
            (stream, moment)
            for stream, moment in self._waiting
            if moment is None or _rank(moment, company[moment]) == first[moment.of]
        )
        return min(eligible, key=self._begins, default=None)

    def _begins(self, place: tuple[S, Moment | None]) -> float:
        """Return a stream's place in the order, in bytes: streams that have sent more come later."""
        return max(self._waiting[place].since, self._ends.get(place[0], 0.0))

    def _replace(self, stream: S, moment: Moment | None) -> int:
        """Drop items made useless by the stream's new item; return how many of them are the stream's."""
        vain = [
            (each, of)
            for each, of in self._waiting
            if each == stream and of is not moment and _is_begun(of) == _is_begun(moment) and None in (of, moment)
        ]
        if moment is not None:
            vain += _vain([(s, m) for s, m in self._waiting if m and m.of == moment.of and m.begun == moment.begun])
        items = [(place[0], self._waiting.pop(place).item) for place in vain]
        self._lost += [item for each, item in items if each != stream]
        return sum(each == stream for each, _ in items)

    def _begin(self, moment: Moment) -> None:
        """Begin a moment: its waiting items are kept from now on, those of earlier moments are dropped."""
        moment.begun = True
        self._begun[moment.of] = moment.number
        for place in list(self._waiting):
            other = place[1]
            if other is not None and other.of == moment.of and not other.begun and other.number < moment.number:
                self._lost.append(self._waiting.pop(place).item)

    def _wait_s(self, size: int) -> float:
        room = max(0.0, self._rate * BACKLOG_S - size)
        return (self._backlog - room - ROUNDING) / self._rate

    def _forget(self) -> None:
        """Forget the places of streams that fell behind: they get no more than their share later."""
        self._ends = {stream: ends for stream, ends in self._ends.items() if ends > self._now}


def _rank(moment: Moment, streams: int) -> tuple[bool, int, int]:
    """Return the sort key of a moment; the highest goes first."""
    return (True, 0, 0) if moment.begun else (False, streams, moment.number)


def _is_begun(moment: Moment | None) -> bool:
    return moment is not None and moment.begun


def _vain(places: list[tuple[S, Moment]]) -> list[tuple[S, Moment]]:
    """Return the items that are neither their stream's newest nor of the moment to begin next.

    places: of one owner's moments, all begun or all not; no stream needs two items of begun moments.
    """
    company = Counter(moment for _, moment in places)
    first = max(company, key=lambda moment: _rank(moment, company[moment]))
    newest = dict(sorted(places, key=lambda place: place[1].number))
    return [
        (stream, moment)
        for stream, moment in places
        if moment is not newest[stream] and (moment.begun or moment is not first)
    ]
