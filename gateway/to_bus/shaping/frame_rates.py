"""Limits a camera's frame rate by picking the same instants on all of its streams. Pure."""

from collections import OrderedDict, deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from statistics import linear_regression, median_low
from typing import Any, Final

from gateway.to_bus.shaping.uplink import Moment

SECOND_NS: Final = 1_000_000_000

FITTED_FRAMES: Final = 16
"""Number of last frames that the rhythm is fitted to; after these it follows a change of rate."""

PREDICTED_FRAMES: Final = 8
"""Number of frames ahead for which the rhythm predicts."""


class Rhythm:
    """The line fitted through the last frames of a stream, of which some may be lost.

    Stamps need not be even: depth often has the nearest ones of a faster stream.
    """

    def __init__(self) -> None:
        self._stamps: deque[int] = deque(maxlen=FITTED_FRAMES)
        self._line: tuple[int, int] | None = None

    def note(self, stamp_ns: int) -> None:
        """Add a frame's stamp; if it is not after the last one, start over."""
        if self._stamps and stamp_ns <= self._stamps[-1]:
            self._stamps.clear()
        self._stamps.append(stamp_ns)
        self._line = None

    @property
    def interval_ns(self) -> int:
        """The interval between frames, lost ones included, in nanoseconds; 0 while unknown."""
        return self._fitted()[1]

    def next_ns(self, since_ns: int) -> int | None:
        """Return when the first frame at or after a time is expected; None if too far away to tell."""
        last_ns, interval_ns = self._fitted()
        if not interval_ns:
            return None
        frames = -((last_ns - since_ns) // interval_ns)
        return last_ns + frames * interval_ns if abs(frames) <= PREDICTED_FRAMES else None

    def _fitted(self) -> tuple[int, int]:
        """Return the fitted stamp of the last frame, and the interval, in nanoseconds."""
        if self._line is None:
            self._line = _fit(self._stamps) if len(self._stamps) > 1 else (0, 0)
        return self._line


def _fit(stamps: Sequence[int]) -> tuple[int, int]:
    gaps = [after - before for before, after in pairwise(stamps)]
    usual = median_low(gaps)
    places = list(accumulate((max(1, round(gap / usual)) for gap in gaps), initial=0))
    interval, first = linear_regression(places, [stamp - stamps[-1] for stamp in stamps])
    return stamps[-1] + round(first + places[-1] * interval), round(interval)


SAME_NS: Final = 5_000_000
"""Largest difference of stamps of one instant."""

EARLY_NS: Final = 10_000_000
"""Time by which jitter may bring a frame before its turn."""

JUMP_NS: Final = SECOND_NS
"""A stream whose stamps go back by more has started over: a bag loops, or a simulation is reset."""

UNMATCHED_LIMIT: Final = 8
"""Frames at instants of its own after which a stream is picked from independently."""

SLOWER: Final = 1.5
"""Ratio of intervals from which a turn waits for the slower stream."""

SHARED_TURN: Final = ""
"""Owner of the turns that a camera's streams take together."""

REMEMBERED: Final = 256
MAX_CLOSE_INSTANTS: Final = 16
"""Most instants remembered per SAME_NS."""


@dataclass(slots=True)
class _Instant:
    """One instant. streams: those with a frame of it. picked: whether it is sent, by rate."""

    stamp_ns: int
    moment: Moment
    streams: set[str] = field(default_factory=set)
    picked: dict[float, bool] = field(default_factory=dict)


class _Run:
    """Instants with increasing stamps, and the next due time by owner and rate."""

    def __init__(self, begin: Callable[[], Moment]) -> None:
        self._begin = begin
        self.latest_ns = 0
        self._instants: OrderedDict[int, list[_Instant]] = OrderedDict()
        self._due: OrderedDict[tuple[str, float], int] = OrderedDict()

    def has(self, stream: str, stamp_ns: int) -> bool:
        """Return whether the stream had a frame with exactly this stamp."""
        return any(
            found.stamp_ns == stamp_ns and stream in found.streams
            for found in self._instants.get(stamp_ns // SAME_NS, ())
        )

    def instant(self, stream: str, stamp_ns: int) -> _Instant:
        """Return the nearest instant that the stream has no frame of yet, or a new one."""
        self.latest_ns = max(self.latest_ns, stamp_ns)
        bucket = stamp_ns // SAME_NS
        near = [
            found
            for neighbour in (bucket - 1, bucket, bucket + 1)
            for found in self._instants.get(neighbour, ())
            if stream not in found.streams and abs(found.stamp_ns - stamp_ns) <= SAME_NS
        ]
        if near:
            return min(near, key=lambda found: abs(found.stamp_ns - stamp_ns))
        made = _Instant(stamp_ns, self._begin())
        found = self._instants.setdefault(bucket, [])
        found.append(made)
        del found[:-MAX_CLOSE_INSTANTS]
        _forget_oldest(self._instants)
        return made

    def take_turn(self, owner: str, rate: float, stamp_ns: int, awaited: Collection[int] = ()) -> bool:
        """Return whether the owner's turn has come; turns are 1 / rate seconds apart.

        awaited: later stamps with priority; a turn is not taken if it would leave none for one of them.
        A frame may come a little before its turn, and one that comes late does not put off the next turn, so that a
        camera as fast as the rate loses none to jitter. As both together are less than a turn, no time of n turns has
        more than n + 1 frames. A turn that is far off was given by a stream with another clock: it does not count.
        """
        period = round(SECOND_NS / rate)
        due = self._due.setdefault((owner, rate), self._due.get((SHARED_TURN, rate), stamp_ns))
        _forget_oldest(self._due)
        if abs(stamp_ns - due) > period + JUMP_NS:
            due = stamp_ns
        early = min(EARLY_NS, period // 4)
        following = max(due, stamp_ns - period * 7 // 10) + period
        if stamp_ns < due - early or any(stamp_ns < each < following - early for each in awaited):
            return False
        self._due[owner, rate] = following
        return True


def _forget_oldest(known: OrderedDict[Any, Any]) -> None:
    if len(known) > REMEMBERED:
        known.popitem(last=False)


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


@dataclass(slots=True)
class _Stream:
    """State of a stream.

    limit: on what it sends. alone, missed: since it last met another, its frames that met none, and those of others
    that did not meet it.
    """

    run: _Run
    limit: TokenBucket = field(default_factory=lambda: TokenBucket(0))
    last_ns: int = 0
    rhythm: Rhythm = field(default_factory=Rhythm)
    alone: int = 0
    missed: int = 0

    @property
    def rate(self) -> float:
        """The stream's limit in frames a second."""
        return self.limit.hz

    @property
    def is_alone(self) -> bool:
        """Whether its frames never share instants with others, nor others' frames with it."""
        return min(self.alone, self.missed) > UNMATCHED_LIMIT


class Instants:
    """Picks `max_hz` instants a second, for all streams of one camera together.

    Stamps say which instants, and the clock of this machine how many: stamps that step back, that come from several
    clocks at once or that run ahead of it, as those of a bag that is played fast, have no more frames sent.

    The stream with the first frame of an instant decides for all streams: whatever a stream missed, it sends
    no frame whose instant another stream left out, nor the other way round. Instants picked at a lower rate are picked
    at a higher one too. A stream whose stamps are never those of the others is picked from by itself. Where streams are
    slower than others, a turn waits for the instant at which the slowest is to be expected.
    """

    def __init__(self) -> None:
        self._moments = 0
        self._newest = _Run(self._moment)
        self._streams: dict[str, _Stream] = {}
        self._limits: dict[float, TokenBucket] = {}

    def pick(self, stream: str, stamp_ns: int, received_ns: int, max_hz: float) -> bool:
        """Return whether a frame of a stream is sent.

        stamp_ns: the sensor's stamp; where it is 0, or one that the stream has used before, received_ns stands for it.
        received_ns: when it came, by this machine's clock.
        """
        state, instant = self._meet(stream, stamp_ns, received_ns)
        if state.rate != max_hz:
            state.limit = TokenBucket(max_hz)
        has_room = state.limit.has_room(received_ns)
        if max_hz not in instant.picked:
            self._decide(stream, state, instant, received_ns)
        if not (instant.picked[max_hz] and has_room):
            return False
        state.limit.take()
        return True

    def moment(self, stream: str, stamp_ns: int, received_ns: int) -> Moment | None:
        """Return the moment that a stream's frame shares with other streams; None if it never shares instants.

        stamp_ns, received_ns: see `pick`.
        """
        state, instant = self._meet(stream, stamp_ns, received_ns)
        return None if state.is_alone else instant.moment

    def _moment(self) -> Moment:
        self._moments += 1
        return Moment(self, self._moments)

    def _meet(self, stream: str, stamp_ns: int, received_ns: int) -> tuple[_Stream, _Instant]:
        state = self._streams.setdefault(stream, _Stream(self._newest))
        says_nothing = stamp_ns in {0, state.last_ns}
        if not says_nothing:
            self._follow_clock(state, stamp_ns)
        if says_nothing or state.run.has(stream, stamp_ns):
            stamp_ns = received_ns
        instant = state.run.instant(stream, stamp_ns)
        self._note_company(stream, state, instant)
        return state, instant

    def _follow_clock(self, state: _Stream, stamp_ns: int) -> None:
        """Begin a new run when a stream's clock goes back; the other streams stay in the old one until theirs does."""
        if stamp_ns < state.last_ns - JUMP_NS:
            if state.run is self._newest:
                self._newest = _Run(self._moment)
            state.run = self._newest
        elif stamp_ns <= self._newest.latest_ns + JUMP_NS:
            state.run = self._newest
        state.last_ns = stamp_ns
        state.rhythm.note(stamp_ns)

    def _note_company(self, stream: str, state: _Stream, instant: _Instant) -> None:
        if not instant.streams:
            state.alone += 1
        for name, other in self._streams.items():
            if name in instant.streams:
                other.alone = state.alone = other.missed = state.missed = 0
            elif name != stream:
                other.missed += 1
        instant.streams.add(stream)

    def _decide(self, stream: str, state: _Stream, instant: _Instant, received_ns: int) -> None:
        if state.is_alone:
            instant.picked[state.rate] = state.run.take_turn(stream, state.rate, instant.stamp_ns)
            return
        awaited = self._awaited(state, instant.stamp_ns)
        picked = True
        rates = sorted({each.rate for each in self._streams.values()}, reverse=True)
        self._limits = {rate: self._limits.get(rate) or TokenBucket(rate) for rate in rates}
        for rate, limit in self._limits.items():
            picked = picked and instant.picked.get(rate, True)
            if picked and rate not in instant.picked:
                picked = limit.has_room(received_ns)
                picked = picked and state.run.take_turn(SHARED_TURN, rate, instant.stamp_ns, awaited)
                if picked:
                    limit.take()
            instant.picked.setdefault(rate, picked)

    def _awaited(self, state: _Stream, stamp_ns: int) -> list[int]:
        """Return the next expected stamps of streams slower than all streams that are due at this instant.

        state: the stream that has the instant's first frame. Of its frames the nearest to another's is that one's.
        """
        near_ns = state.rhythm.interval_ns // 2
        company = [each.rhythm for each in self._streams.values() if each.run is state.run and not each.is_alone]
        due = [(each.interval_ns, each.next_ns(stamp_ns - near_ns)) for each in company if each is not state.rhythm]
        here = [interval for interval, next_ns in due if next_ns is not None and next_ns <= stamp_ns + near_ns]
        slowest_ns = max([state.rhythm.interval_ns, *here])
        return [
            next_ns
            for interval, next_ns in due
            if next_ns is not None and next_ns > stamp_ns + near_ns and interval > SLOWER * slowest_ns > 0
        ]


class StreamRate:
    """The rate limit of one stream in its camera's instants. max_hz may change at any time; None sends all.

    instants: returns the camera's, which may be others when the stream was away.
    """

    def __init__(self, instants: Callable[[], Instants], stream: str, max_hz: float | None) -> None:
        self._instants = instants
        self._stream = stream
        self.max_hz = max_hz

    def passes(self, stamp_ns: int, received_ns: int) -> bool:
        """Return whether a frame is sent; see `Instants.pick`."""
        return self.max_hz is None or self._instants().pick(self._stream, stamp_ns, received_ns, self.max_hz)
