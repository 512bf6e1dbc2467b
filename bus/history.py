"""The order of what publishers sent: it comes live, and once more from what they keep for who was late or cut off.

Pure. Times are somebody else's.
"""

from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Final, Generic, NamedTuple, TypeVar

MOST_HELD: Final = 200
"""Messages of a key that wait for older ones to be fetched, or twice as many as are wanted of what a publisher keeps if
that is more; then they are taken as they are."""

KEYS_REMEMBERED: Final = 10_000
"""Keys without a publisher of which it is known what came: what was kept comes again when it is back."""

PUBLISHERS_REMEMBERED: Final = 16
"""Of one key, those heard last."""

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

    last: the number taken last, and its place; live: the newest that came on this session as it was sent.
    """

    last: int | None = None
    place: Any = None
    live: int = -1


@dataclass(slots=True)
class _Key(Generic[M]):
    """What is known of a key.

    caches: of publishers that are there. asked: those that are being asked, and whether they are to be asked once more.
    held: what came live and waits for what they have; kept: what they have answered.
    """

    publishers: OrderedDict[int | str, _Publisher] = field(default_factory=OrderedDict)
    caches: set[str] = field(default_factory=set)
    asked: dict[str, bool] = field(default_factory=dict)
    held: list[Numbered[M]] | None = None
    kept: list[Numbered[M]] = field(default_factory=list)

    def publisher(self, name: int | str) -> _Publisher:
        known = self.publishers.get(name)
        if known is None:
            known = self.publishers[name] = _Publisher()
            if len(self.publishers) > PUBLISHERS_REMEMBERED:
                self.publishers.popitem(last=False)
        return known


@dataclass
class History(Generic[M]):
    """What came of each publisher.

    recover: how many of the messages that a publisher keeps are wanted; with more than one, a hole in the live messages
    is filled too, and what is live waits for what was before. fetch: has a cache asked, `kept` called with its answers
    and `fetched` at their end, however it comes about. deliver, miss: take messages in order, and the number of those
    that never came.

    Not to be called from several threads at once.
    """

    recover: int
    fetch: Callable[[Fetch], None]
    deliver: Callable[[list[M]], None]
    miss: Callable[[int], None]
    _keys: dict[str, _Key[M]] = field(default_factory=dict)
    _deserted: OrderedDict[str, None] = field(default_factory=OrderedDict)

    def appear(self, key: str, cache: str) -> None:
        """A key's publisher is there, for the first time or again, and its cache can be asked."""
        known = self._known(key)
        known.caches.add(cache)
        self._deserted.pop(key, None)
        self._ask(key, known, cache)

    def leave(self, key: str, cache: str) -> None:
        """A publisher is not there any more, or cannot be reached."""
        known = self._known(key)
        known.caches.discard(cache)
        if not known.caches:
            self._desert(key)

    def cut_off(self) -> None:
        """Nobody can be reached any more; what waits for older ones waits until it is known who is still there."""
        for key, known in self._keys.items():
            known.caches.clear()
            known.asked.clear()
            known.kept.clear()
            for publisher in known.publishers.values():
                publisher.live = -1
            self._deserted[key] = None

    def all_appeared(self) -> None:
        """Whoever is there has appeared; nothing more comes of what the others kept."""
        ready: list[M] = []
        for key in self._deserted:
            self._release(self._keys[key], ready)
        self._forget_deserted()
        self._deliver(ready)

    def live(self, messages: Iterable[Numbered[M]]) -> None:
        """Take messages as they come."""
        ready: list[M] = []
        for each in messages:
            key, name, number, message, newness, place = each
            known = self._keys.get(key) or self._known(key)
            if known.held is not None:
                known.held.append(each)
                if len(known.held) > max(MOST_HELD, 2 * self.recover):
                    self._take_held(known, ready)
            elif (by := known.publishers.get(name)) and by.last == number - 1 and not newness:  # nearly always
                by.last = by.live = number
                by.place = place
                ready.append(message)
            else:
                self._take_live(known, each, ready)
        self._deliver(ready)

    def kept(self, fetch: Fetch, message: Numbered[M]) -> None:
        """Take what a cache has."""
        known = self._known(fetch.key)
        if fetch.cache in known.asked and message.key == fetch.key:
            known.kept.append(message)

    def fetched(self, fetch: Fetch) -> None:
        """There is nothing more to come from a cache."""
        known = self._known(fetch.key)
        again = known.asked.pop(fetch.cache, None)
        if again:
            self._ask(fetch.key, known, fetch.cache)
        elif again is not None and not known.asked:
            ready: list[M] = []
            self._release(known, ready)
            self._deliver(ready)

    def _known(self, key: str) -> _Key[M]:
        known = self._keys.get(key)
        if known is None:
            known = self._keys[key] = _Key()
            self._desert(key)
        return known

    def _desert(self, key: str) -> None:
        self._deserted[key] = None
        self._deserted.move_to_end(key)
        self._forget_deserted()

    def _forget_deserted(self) -> None:
        while len(self._deserted) > KEYS_REMEMBERED:
            key, _ = self._deserted.popitem(last=False)
            ready: list[M] = []
            self._release(self._keys.pop(key), ready)
            self._deliver(ready)

    def _ask(self, key: str, known: _Key[M], cache: str) -> None:
        if self.recover > 1 and known.held is None:
            known.held = []
        if cache in known.asked:
            known.asked[cache] = True
            return
        known.asked[cache] = False
        places = tuple(each.place for each in known.publishers.values() if each.place is not None)
        self.fetch(Fetch(key, cache, places))

    def _take_live(self, known: _Key[M], each: Numbered[M], ready: list[M]) -> None:
        publisher = known.publisher(each.publisher)
        last = publisher.last
        is_next = last is None or each.number <= last + 1
        if self.recover > 1 and known.caches and not (is_next or each.newness):
            for cache in known.caches:
                self._ask(each.key, known, cache)
            known.held = [each]
            return
        publisher.live = each.number
        self._take(publisher, each, ready)

    def _take(self, publisher: _Publisher, each: Numbered[M], ready: list[M]) -> None:
        """Take a message unless it came before or is more than what is wanted; count those before it that did not."""
        if each.newness > self.recover:
            return
        last = publisher.last
        if last is not None and last - each.number < WRAPPED:
            if each.number <= last:
                return
            if each.number > last + 1:
                self.miss(each.number - last - 1)
        publisher.last, publisher.place = each.number, each.place
        ready.append(each.message)

    def _take_held(self, known: _Key[M], ready: list[M]) -> None:
        """Take what is held, and before it what caches have that does not come live as well."""
        held = known.held or []
        for each in held:
            publisher = known.publisher(each.publisher)
            publisher.live = max(publisher.live, each.number)
        older = [each for each in known.kept if not 0 <= known.publisher(each.publisher).live < each.number]
        for each in sorted(older + held, key=_number):
            self._take(known.publisher(each.publisher), each, ready)
        held.clear()
        known.kept.clear()

    def _release(self, known: _Key[M], ready: list[M]) -> None:
        self._take_held(known, ready)
        known.held = None

    def _deliver(self, ready: list[M]) -> None:
        if ready:
            self.deliver(ready)


def _number(message: Numbered[Any]) -> int:
    return message.number
