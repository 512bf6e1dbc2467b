"""The order of what publishers sent: it comes live, and once more from what they keep for who was late or cut off.

Pure. Times are somebody else's.
"""

from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Final, Generic, NamedTuple, TypeVar

from schemas.header import gap

MOST_HELD: Final = 200
"""Messages of a key that wait for older ones to be fetched, or twice as many as are wanted of what a publisher keeps if
that is more; then they are taken as they are."""

KEYS_REMEMBERED: Final = 10_000
"""Keys without a publisher of which it is known what came: what was kept comes again when it is back."""

PUBLISHERS_REMEMBERED: Final = 128
"""Of one key, those heard last; a gateway has one for each of as many as 64 that latch a topic."""

NONE: Final = -1
"""Less than any number."""

FIRST: Final = 1
"""The first number of a publisher of ours; Zenoh's own begin with 0."""

WRAPPED: Final = 1 << 31
"""A number so much smaller than the last is a newer one: Zenoh's own have 32 bits."""

M = TypeVar("M")


class Numbered(NamedTuple, Generic[M]):
    """A message, its publisher among those of its key, and its number among this one's, which grows by one.

    newness: 0 where it is sent for the first time; else it is one of those a publisher took to a new session, 1 the
    newest. place: what its cache, asked for what came later, needs to know of it.
    """

    key: str
    publisher: int | str
    number: int
    message: M
    newness: int = 0
    place: Any = None


class Fetch(NamedTuple):
    """What to ask a cache for: what a key's publisher sent after those in their places, as far as they are its own."""

    key: str
    cache: str
    places: tuple[Any, ...] = ()


@dataclass(slots=True)
class _Publisher:
    """What came of one.

    last: the number taken last, and its place. live: the newest that came since it is there, so that all newer ones
    come by themselves. sought: the newest that had come when a cache was asked last.
    """

    last: int = NONE
    place: Any = None
    live: int = NONE
    sought: int = NONE

    def is_behind_hole(self, number: int) -> bool:
        return self.last != NONE and number > self.last + 1

    def is_next(self, number: int, first: int) -> bool:
        return number <= first if self.last == NONE else number == self.last + 1


@dataclass(slots=True)
class _Key(Generic[M]):
    """What is known of a key.

    caches: of publishers that are there. asked: those that are being asked, and whether they are to be asked once more.
    doubted: those that are there and had nothing when they were asked first.
    held: what came live and waits for what they have, None if nothing has to; kept: what they have answered.
    """

    name: str
    publishers: OrderedDict[int | str, _Publisher] = field(default_factory=OrderedDict)
    caches: set[str] = field(default_factory=set)
    asked: dict[str, bool] = field(default_factory=dict)
    doubted: set[str] = field(default_factory=set)
    held: list[Numbered[M]] | None = None
    kept: list[Numbered[M]] = field(default_factory=list)

    def publisher(self, name: int | str) -> _Publisher:
        known = self.publishers.get(name)
        if known is None:
            known = self.publishers[name] = _Publisher()
            if len(self.publishers) > PUBLISHERS_REMEMBERED:
                self.publishers.popitem(last=False)
        else:
            self.publishers.move_to_end(name)
        return known

    def out_of_sight(self) -> None:
        """What came of its publishers so far says nothing of what else is on its way."""
        for publisher in self.publishers.values():
            publisher.live = NONE


@dataclass
class History(Generic[M]):
    """What came of each publisher.

    recover: how many of the messages that a publisher keeps are wanted; with more than one, a hole in the live messages
    is filled too, and what is live waits for what was before. fetch: has a cache asked, `kept` called with its answers
    and `fetched` at their end, however it comes about. later: has `ask_again` called in a while, with what is asked
    for. deliver, miss: take messages in order, and the number of those that never came.

    Not to be called from several threads at once.
    """

    recover: int
    fetch: Callable[[Fetch], None]
    later: Callable[[Fetch], None]
    deliver: Callable[[list[M]], None]
    miss: Callable[[int], None]
    _keys: dict[str, _Key[M]] = field(default_factory=dict)
    _deserted: OrderedDict[str, None] = field(default_factory=OrderedDict)
    _all_appeared: bool = True

    def appear(self, key: str, cache: str) -> None:
        """A key's publisher is there, for the first time or again, and its cache can be asked."""
        known = self._known(key)
        if cache not in known.caches:
            known.out_of_sight()
            known.caches.add(cache)
        self._deserted.pop(key, None)
        self._ask(known, cache)

    def leave(self, key: str, cache: str) -> None:
        """A publisher is not there any more, or cannot be reached."""
        known = self._known(key)
        known.caches.discard(cache)
        known.doubted.discard(cache)
        if not known.caches:
            self._desert(key)

    def cut_off(self) -> None:
        """Nobody can be reached any more; what waits for older ones waits until it is known who is still there."""
        self._all_appeared = False
        for key, known in self._keys.items():
            known.out_of_sight()
            known.caches.clear()
            known.asked.clear()
            known.doubted.clear()
            known.kept.clear()
            self._deserted[key] = None

    def all_appeared(self) -> None:
        """Whoever is there has appeared; nothing more comes of what the others kept."""
        self._all_appeared = True
        ready: list[M] = []
        for known in self._keys.values():
            if known.held is not None and not (known.asked and known.caches):
                self._release(known, ready)
        self._forget_deserted(ready)
        self._deliver(ready)

    def live(self, messages: Iterable[Numbered[M]], *, current: bool = True) -> None:
        """Take messages as they come. current: since the last `cut_off`, as far as that is known."""
        ready: list[M] = []
        for each in messages:
            key, name, number, message, newness, place = each
            known = self._keys.get(key) or self._known(key)
            by = known.publishers.get(name)
            if known.held is None and by and by.last == number - 1 and not newness and current:  # nearly always
                by.last = by.live = number
                by.place = place
                known.publishers.move_to_end(name)
                ready.append(message)
            elif newness <= self.recover:
                by = known.publisher(name)
                if current:
                    by.live = max(by.live, number)
                self._take_live(known, by, each, ready)
        self._deliver(ready)

    def kept(self, fetch: Fetch, message: Numbered[M]) -> None:
        """Take what a cache has."""
        known = self._known(fetch.key)
        if fetch.cache in known.asked and message.key == fetch.key and message.newness <= self.recover:
            known.kept.append(message)

    def fetched(self, fetch: Fetch, *, empty: bool = False) -> None:
        """There is nothing more to come from a cache. empty: nothing came.

        The first time that says little: of a link that is new a router may know that a cache is there, and not yet the
        way to it.
        """
        known = self._known(fetch.key)
        cache = fetch.cache
        if empty and cache in known.asked and cache in known.caches and cache not in known.doubted:
            known.doubted.add(cache)
            self.later(fetch)
            return
        again = known.asked.pop(cache, None)
        if again:
            self._ask(known, cache)
        elif again is not None and not known.asked:
            ready: list[M] = []
            self._release(known, ready)
            self._deliver(ready)

    def ask_again(self, fetch: Fetch) -> None:
        """Ask a cache that had nothing."""
        known = self._known(fetch.key)
        if fetch.cache in known.asked:
            self._fetch(known, fetch.cache)

    def _known(self, key: str) -> _Key[M]:
        known = self._keys.get(key)
        if known is None:
            known = self._keys[key] = _Key(key)
            self._desert(key)
        return known

    def _desert(self, key: str) -> None:
        self._deserted[key] = None
        self._deserted.move_to_end(key)
        ready: list[M] = []
        self._forget_deserted(ready)
        self._deliver(ready)

    def _forget_deserted(self, ready: list[M]) -> None:
        while len(self._deserted) > KEYS_REMEMBERED:
            key, _ = self._deserted.popitem(last=False)
            self._release(self._keys.pop(key), ready)

    def _ask(self, known: _Key[M], cache: str) -> None:
        if self.recover > 1 and known.held is None:
            known.held = []
        for publisher in known.publishers.values():
            publisher.sought = max(publisher.sought, publisher.last)
        for each in known.held or ():
            publisher = known.publisher(each.publisher)
            publisher.sought = max(publisher.sought, each.number)
        if cache in known.asked:
            known.asked[cache] = True
            return
        known.asked[cache] = False
        self._fetch(known, cache)

    def _fetch(self, known: _Key[M], cache: str) -> None:
        places = tuple(each.place for each in known.publishers.values() if each.place is not None)
        self.fetch(Fetch(known.name, cache, places))

    def _take_live(self, known: _Key[M], by: _Publisher, each: Numbered[M], ready: list[M]) -> None:
        """Take what came live, or hold it while there may be older ones to come."""
        first = FIRST if isinstance(each.publisher, int) else 0
        if known.held is not None and not known.held and by.is_next(each.number, first) and not each.newness:
            self._take(by, each, ready)
        elif known.held is not None:
            known.held.append(each)
            if len(known.held) > max(MOST_HELD, 2 * self.recover):
                self._take_waiting(known, ready, seek=False)
        elif self.recover > 1 and not self._all_appeared:
            known.held = [each]
        elif self.recover > 1 and known.caches and by.is_behind_hole(each.number):
            known.held = [each]
            self._seek(known)
        else:
            self._take(by, each, ready)

    def _seek(self, known: _Key[M]) -> None:
        for cache in known.caches:
            self._ask(known, cache)

    def _take(self, by: _Publisher, each: Numbered[M], ready: list[M]) -> None:
        """Take a message unless it came before; count those before it that did not."""
        if by.last - each.number < WRAPPED:
            if each.number <= by.last:
                return
            if by.is_behind_hole(each.number):
                self.miss(gap(by.last, each.number))
        by.last, by.place = each.number, each.place
        ready.append(each.message)

    def _take_waiting(self, known: _Key[M], ready: list[M], *, seek: bool) -> None:
        """Take what is held and what caches answered, in order.

        What is newer than the newest that came live does so, too, after what is in between; or else what follows shows
        the hole.
        seek: holes among what came after caches were asked are worth asking again; what is behind them is held on.
        """
        waiting = [(each, True) for each in known.held or ()] + [(each, False) for each in known.kept]
        rest: list[Numbered[M]] = []
        for each, came in sorted(waiting, key=lambda one: one[0].number):
            by = known.publisher(each.publisher)
            if not by.is_behind_hole(each.number):
                self._take(by, each, ready)
            elif came and seek and each.number > by.sought:
                rest.append(each)
            elif came or by.live == NONE or each.number <= min(by.live, by.sought):
                self._take(by, each, ready)
        known.kept.clear()
        known.held = rest

    def _release(self, known: _Key[M], ready: list[M]) -> None:
        """Take all that waits, as complete as it gets."""
        self._take_waiting(known, ready, seek=self.recover > 1 and bool(known.caches))
        if known.held:
            self._seek(known)
        else:
            known.held = None

    def _deliver(self, ready: list[M]) -> None:
        if ready:
            self.deliver(ready)
