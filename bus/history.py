"""The order of what publishers sent: it comes live, and once more from what they keep for who was late or cut off."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final, Generic, NamedTuple, TypeVar

MOST_HELD: Final = 200
"""Messages of a publisher that wait for older ones to be fetched, or twice as many as are wanted of what it keeps if
that is more; then they are taken as they are."""

GONE_REMEMBERED: Final = 10_000
"""Publishers that left of whom it is known what came: what they kept comes again from their next session."""

WRAPPED: Final = 1 << 31
"""A number so much smaller than the last is a newer one: Zenoh's have 32 bits."""

M = TypeVar("M")


class Numbered(NamedTuple, Generic[M]):
    """A message, of which publisher it is, and its number among this one's, which grows by one.

    origin: publisher and number it was sent as at first, if it is one that a publisher took to its next session.
    """

    source: str
    number: int
    message: M
    origin: tuple[str, int] | None = None


class Fetch(NamedTuple):
    """What to ask the cache for that answers under the key `cache`: what came after a number, if any did."""

    cache: str
    source: str
    after: int | None


@dataclass(slots=True)
class _Source(Generic[M]):
    """One publisher.

    last: the number taken last; again: the same of what it took to other sessions; held: what came while older ones are
    fetched; kept: which of it come from a cache.
    """

    last: int | None = None
    again: int | None = None
    held: dict[int, Numbered[M]] | None = None
    kept: set[int] = field(default_factory=set)
    cache: str = ""

    @property
    def newest(self) -> int | None:
        """The number of the newest message, on whatever session it came."""
        return max((number for number in (self.last, self.again) if number is not None), default=None)


@dataclass
class History(Generic[M]):
    """What came of each publisher.

    recover: how many of the messages that a publisher keeps are wanted; with more than one, a hole in the live messages
    is filled too. fetch: has a cache asked, `kept` called with its answers and `fetched` at their end, however it
    comes about. deliver, miss: take messages in order, and the number of those that never came.

    Not to be called from several threads at once.
    """

    recover: int
    fetch: Callable[[Fetch], None]
    deliver: Callable[[list[M]], None]
    miss: Callable[[int], None]
    _sources: dict[str, _Source[M]] = field(default_factory=dict)
    _gone: dict[str, None] = field(default_factory=dict)
    _fetching: set[str] = field(default_factory=set)

    def appear(self, source: str, cache: str) -> None:
        """A publisher is there, for the first time or again; its cache answers under a key."""
        known = self._known(source)
        known.cache = cache
        self._gone.pop(source, None)
        self._fetch(source, known)

    def leave(self, source: str) -> None:
        """A publisher is not there any more, or cannot be reached."""
        if source in self._sources:
            self._sources[source].cache = ""
            self._forget_in_time(source)

    def cut_off(self) -> None:
        """Nobody can be reached any more; what waits for older ones waits until its publisher can."""
        for source in [source for source, known in self._sources.items() if known.cache]:
            self.leave(source)
        self._fetching.clear()

    def live(self, messages: Iterable[Numbered[M]]) -> None:
        """Take messages as they come."""
        ready: list[M] = []
        for each in messages:
            source, number, message, origin = each
            known = self._sources.get(source)
            if known is None:
                known = self._known(source)
            if known.held is None and origin is None and known.last == number - 1:  # nearly always
                known.last = number
                ready.append(message)
            elif known.held is not None:
                self._hold(known, each)
                if len(known.held) > max(MOST_HELD, 2 * self.recover):
                    self._release(known, ready)
            elif known.last is not None and number > known.last + 1 and self.recover > 1 and known.cache:
                self._fetch(source, known)
                self._hold(known, each)
            else:
                self._take(known, each, ready)
        self.deliver(ready)

    def kept(self, message: Numbered[M]) -> None:
        """Take what a cache has."""
        known = self._known(message.source)
        if known.held is not None:
            known.kept.add(message.number)
            self._hold(known, message)

    def fetched(self, source: str) -> None:
        """There is nothing more to come from a cache: what is held is as complete as it gets."""
        self._fetching.discard(source)
        known = self._sources.get(source)
        if known is None or known.held is None:
            return
        ready: list[M] = []
        self._release(known, ready)
        known.held = None
        self.deliver(ready)

    def _known(self, source: str) -> _Source[M]:
        known = self._sources.get(source)
        if known is None:
            known = self._sources[source] = _Source()
            self._forget_in_time(source)
        return known

    def _forget_in_time(self, source: str) -> None:
        self._gone[source] = None
        if len(self._gone) > GONE_REMEMBERED:
            oldest = next(iter(self._gone))
            del self._gone[oldest], self._sources[oldest]

    def _fetch(self, source: str, known: _Source[M]) -> None:
        if known.held is None:
            known.held = {}
        if source not in self._fetching:
            self._fetching.add(source)
            self.fetch(Fetch(known.cache, source, known.last))

    def _hold(self, known: _Source[M], message: Numbered[M]) -> None:
        if known.held is not None:
            known.held.setdefault(message.number, message)
            if message.origin is not None:
                known.kept.add(message.number)

    def _release(self, known: _Source[M], ready: list[M]) -> None:
        """Take what is held; of what comes from a cache no more than is wanted."""
        held, unwanted = known.held or {}, set(sorted(known.kept)[: -self.recover])
        for number in sorted(held):
            if number in unwanted:
                self._pass(known, held[number])
            else:
                self._take(known, held[number], ready)
        held.clear()
        known.kept.clear()

    def _take(self, known: _Source[M], message: Numbered[M], ready: list[M]) -> None:
        """Take a message, unless it came before; count those between it and the one before."""
        if known.last is not None and known.last - message.number < WRAPPED:
            if message.number <= known.last:
                return
            self._miss(message.number - known.last - 1)
        if message.origin is None:
            known.last = message.number
            ready.append(message.message)
            return
        before, number = self._known(message.origin[0]), message.origin[1]
        if before.held and before is not known:  # that session is over: nothing older comes of it
            self._release(before, ready)
        newest = before.newest
        if newest is None or number > newest:
            self._miss(0 if newest is None else number - newest - 1)
            ready.append(message.message)
        self._pass(known, message)

    def _miss(self, number: int) -> None:
        if number:
            self.miss(number)

    def _pass(self, known: _Source[M], message: Numbered[M]) -> None:
        """Take it that a message came."""
        known.last = max(message.number, known.last or 0)
        if message.origin is not None:
            before = self._known(message.origin[0])
            before.again = max(message.origin[1], before.again or 0)
