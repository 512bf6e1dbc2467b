"""Orders messages that come live and again from publishers' caches, after a late start or a lost link.

Pure. Delays are the caller's.
"""

from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final, Generic

from bus.history.key_state import FIRST, LATE_RUN, NONE, Fetch, Hold, KeyState, M, Numbered, PublisherState
from schemas.header import gap

MOST_HELD: Final = 200
"""Most messages of a key that wait for older ones to be fetched, or twice `History.recover` if
that is more; beyond that they are taken as they are."""

KEYS_REMEMBERED: Final = 10_000
"""Keys without a publisher whose numbers are remembered: kept messages come again when it returns."""

MOST_HELD_BYTES: Final = 32 << 20
"""Most bytes of messages that wait, of all keys together; beyond that they are taken as they are, too."""

ON_THEIR_WAY: Final = 64
"""More live messages of a key than come out of order."""

BACKLOG: Final = 1_000
"""More of them than wait behind a cache's answer: a link that stands still for longer than a few seconds is cut."""

WRAPPED: Final = 1 << 31
"""A number smaller than the last by this much is newer: Zenoh's own numbers wrap at 32 bits."""


@dataclass
class History(Generic[M]):
    """The message history of all publishers of a subscription.

    recover: the number of kept messages wanted from each publisher; with more than one, gaps in the live messages are
    filled too, and live messages wait for older ones. fetch: queries a cache, calls `kept` with its answers
    and `fetched` at the end in any case. later: calls `ask_again` after a while with the same
    query. holding: calls `end_hold` after a longer while with the same hold. deliver, miss: receive messages in order,
    and the number of lost ones. size: the bytes of a message.

    Not thread-safe.
    """

    recover: int
    fetch: Callable[[Fetch], None]
    later: Callable[[Fetch], None]
    holding: Callable[[Hold], None]
    deliver: Callable[[list[M]], None]
    miss: Callable[[int], None]
    size: Callable[[M], int] = lambda _: 0
    _bytes: int = 0
    _keys: dict[str, KeyState[M]] = field(default_factory=dict)
    _deserted: OrderedDict[str, None] = field(default_factory=OrderedDict)
    _all_appeared: bool = True

    def appear(self, key: str, cache: str) -> None:
        """Note that a key's publisher appeared, so its cache can be asked."""
        known = self._known(key)
        if cache not in known.caches:
            known.out_of_sight()
            known.caches.add(cache)
        self._deserted.pop(key, None)
        self._ask(known, cache)

    def leave(self, key: str, cache: str) -> None:
        """Note that a publisher left or became unreachable."""
        known = self._known(key)
        known.caches.discard(cache)
        known.doubted.discard(cache)
        if not known.caches:
            self._desert(key)

    def cut_off(self) -> None:
        """Note that all links are lost; held messages wait until it is known which publishers are still present."""
        self._all_appeared = False
        for key, known in self._keys.items():
            known.out_of_sight()
            known.caches.clear()
            known.asked.clear()
            known.doubted.clear()
            self._bytes -= sum(self.size(each.message) for each in known.kept)
            known.kept.clear()
            self._deserted[key] = None
            if known.held is not None:  # on the new session, as what is timed on the old one is not heeded there
                self._hold(known, known.held)

    def all_appeared(self) -> None:
        """Note that all present publishers have appeared; messages kept by others will not come."""
        self._all_appeared = True
        ready: list[M] = []
        for known in self._keys.values():
            if known.held is not None and not (known.asked and known.caches):
                self._release(known, ready)
        self._forget_deserted(ready)
        self._deliver(ready)

    def live(self, messages: Iterable[Numbered[M]], *, current: bool = True) -> None:
        """Take live messages. current: sent since the last `cut_off`, as far as that is known."""
        ready: list[M] = []
        for each in messages:
            key, name, number, message = each
            known = self._keys.get(key) or self._known(key)
            by = known.publishers.get(name)
            if known.held is None and by and by.last == number - 1 and current:  # the usual case
                by.last = by.live = number
                known.publishers.move_to_end(name)
                ready.append(message)
            else:
                by = known.publisher(name)
                if current:
                    by.live = max(by.live, number)
                if current and known.held is None and self._is_far_behind(by, number) and by.goes_on(number):
                    self.miss(LATE_RUN - 1)
                self._take_live(known, by, each, ready)
        self._deliver(ready)

    def kept(self, fetch: Fetch, message: Numbered[M]) -> None:
        """Take a message from a cache."""
        known = self._known(fetch.key)
        if fetch.cache in known.asked and message.key == fetch.key:
            if self._bytes > MOST_HELD_BYTES:
                self.miss(1)
                return
            self._bytes += self.size(message.message)
            known.kept.append(message)

    def fetched(self, fetch: Fetch, *, empty: bool = False) -> None:
        """Note that a cache's answer is complete. empty: it had no messages.

        The first empty answer says little: on a new link a router may know of a cache before it knows the route
        to it.
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
        """Ask an empty cache again."""
        known = self._known(fetch.key)
        if fetch.cache in known.asked:
            self._fetch(known, fetch.cache)

    def end_hold(self, hold: Hold) -> None:
        """Take a key's held messages as they are if they still wait: caches that do not answer hold up no key for ever.

        Answers that come later still fill in what is newer than what was taken.
        """
        known = self._keys.get(hold.key)
        if known is not None and known.held is not None and known.holds == hold.number:
            ready: list[M] = []
            self._take_waiting(known, ready, seek=False)
            known.held = None
            self._deliver(ready)

    def _hold(self, known: KeyState[M], held: list[Numbered[M]]) -> None:
        known.held = held
        known.holds += 1
        self.holding(Hold(known.name, known.holds))

    def _hold_first(self, known: KeyState[M], each: Numbered[M]) -> None:
        self._bytes += self.size(each.message)
        self._hold(known, [each])

    def _known(self, key: str) -> KeyState[M]:
        known = self._keys.get(key)
        if known is None:
            known = self._keys[key] = KeyState(key)
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

    def _ask(self, known: KeyState[M], cache: str) -> None:
        if self.recover > 1 and known.held is None:
            self._hold(known, [])
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

    def _fetch(self, known: KeyState[M], cache: str) -> None:
        taken = tuple((name, each.last) for name, each in known.publishers.items() if each.last != NONE)
        self.fetch(Fetch(known.name, cache, taken))

    def _take_live(self, known: KeyState[M], by: PublisherState, each: Numbered[M], ready: list[M]) -> None:
        """Take a live message, or hold it while older ones may still come."""
        first = FIRST if isinstance(each.publisher, int) else 0
        if known.held is not None and not known.held and by.is_next(each.number, first):
            self._take(by, each, ready)
        elif known.held is not None:
            known.held.append(each)
            self._bytes += self.size(each.message)
            if len(known.held) > max(MOST_HELD, 2 * self.recover) or self._bytes > MOST_HELD_BYTES:
                self._take_waiting(known, ready, seek=False)
        elif self.recover > 1 and not self._all_appeared:
            self._hold_first(known, each)
        elif self.recover > 1 and known.caches and by.is_behind_hole(each.number):
            self._hold_first(known, each)
            self._seek(known)
        else:
            self._take(by, each, ready)

    def _seek(self, known: KeyState[M]) -> None:
        for cache in known.caches:
            self._ask(known, cache)

    def _is_far_behind(self, by: PublisherState, number: int) -> bool:
        """Return whether a live message is older than the last one, and no cache had that one before it came live."""
        behind = by.last - number
        return behind < WRAPPED and (behind > BACKLOG or (behind > ON_THEIR_WAY and by.last > by.kept))

    def _take(self, by: PublisherState, each: Numbered[M], ready: list[M]) -> None:
        """Take a message unless it came before; count missing ones before it."""
        if by.last - each.number < WRAPPED:
            if each.number <= by.last:
                return
            if by.is_behind_hole(each.number):
                self.miss(gap(by.last, each.number))
        by.last = each.number
        ready.append(each.message)

    def _take_waiting(self, known: KeyState[M], ready: list[M], *, seek: bool) -> None:
        """Take held messages and caches' answers, in order.

        Messages newer than the newest live one will come live too, after those in between; or a later one reveals
        the gap.
        seek: gaps among messages that came after the caches were asked are asked for again; messages behind them wait.
        """
        waiting = [(each, True) for each in known.held or ()] + [(each, False) for each in known.kept]
        rest: list[Numbered[M]] = []
        self._bytes -= sum(self.size(each.message) for each, _ in waiting)
        for each, came in sorted(waiting, key=lambda one: one[0].number):
            by = known.publisher(each.publisher)
            if not came:
                by.kept = max(by.kept, each.number)
            if not by.is_behind_hole(each.number):
                self._take(by, each, ready)
            elif came and seek and each.number > by.sought:
                rest.append(each)
            elif came or by.live == NONE or each.number <= min(by.live, by.sought):
                self._take(by, each, ready)
        known.kept.clear()
        known.held = rest
        self._bytes += sum(self.size(each.message) for each in rest)

    def _release(self, known: KeyState[M], ready: list[M]) -> None:
        """Take all waiting messages; no more of the missing ones will come."""
        self._take_waiting(known, ready, seek=self.recover > 1 and bool(known.caches))
        if known.held:
            self._seek(known)
        else:
            known.held = None

    def _deliver(self, ready: list[M]) -> None:
        if ready:
            self.deliver(ready)
