"""Bounded mailboxes between producers and a consumer, with every drop counted. Pure: no lock, no loop, no clock."""

import heapq
import sys
from collections import OrderedDict, defaultdict, deque
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeVar, final

import msgspec

MAX_KEYS: Final = 10_000
"""Most keys that a mailbox holds at once."""

K = TypeVar("K", bound=Hashable)
T = TypeVar("T")


class Taken(msgspec.Struct, Generic[K, T], frozen=True, gc=False):
    """An item, and the number of items of its key dropped since the last one was taken."""

    key: K
    item: T
    dropped: int


class Mailbox(Protocol[K, T]):
    """The mailbox interface that a subscription uses."""

    def offer(self, key: K, item: T) -> int:
        """Add an item; return the number of items dropped for it."""

    def take(self) -> Taken[K, T] | None:
        """Take the next item out, or None."""


@dataclass(slots=True)
class _Slot(Generic[T]):
    """One key's waiting items (oldest first), the turn it was last served in, and its drops since then."""

    items: list[T]  # a deque takes 600 bytes, and most slots have one item
    served: int = 0
    dropped: int = 0


@final
class PerKey(Generic[K, T]):
    """Keep the `depth` newest items of each key; the key served longest ago is next.

    Items without room within `most_bytes` are dropped. size: the bytes of an item.
    """

    def __init__(
        self,
        depth: int = 1,
        *,
        max_keys: int = MAX_KEYS,
        most_bytes: int = sys.maxsize,
        size: Callable[[T], int] = lambda _: 0,
    ) -> None:
        self._depth = depth
        self._max_keys = max_keys
        self._most_bytes = most_bytes
        self._size = size
        self._bytes = 0
        self._waiting: dict[K, _Slot[T]] = {}
        self._idle: OrderedDict[K, int] = OrderedDict()
        self._ready: list[tuple[int, int, K]] = []
        self._turn = 0
        self._arrival = 0

    def offer(self, key: K, item: T, depth: int = 0) -> int:
        """Add an item; return the number of older items of its key dropped, or 1 if there is no room for it.

        depth: how many of this key may wait now, if that is more than of others.
        """
        slot = self._waiting.get(key)
        if slot is None:
            if len(self._waiting) >= self._max_keys or not self._has_room(item, 0):
                return 1
            slot = self._waiting[key] = _Slot([], self._idle.pop(key, 0))
            self._enlist(key, slot)
        dropped = max(0, len(slot.items) + 1 - max(self._depth, depth))
        gone = sum(map(self._size, slot.items[:dropped]))
        if not self._has_room(item, gone):
            slot.dropped += 1
            return 1
        del slot.items[:dropped]
        slot.dropped += dropped
        slot.items.append(item)
        self._bytes += self._size(item) - gone
        return dropped

    def _has_room(self, item: T, gone: int) -> bool:
        """Return whether an item fits once others of so many bytes are gone; one alone always does."""
        left = self._bytes - gone
        return not left or left + self._size(item) <= self._most_bytes

    def take(self) -> Taken[K, T] | None:
        """Take the oldest item of the key that was served longest ago."""
        if not self._ready:
            return None
        _, _, key = heapq.heappop(self._ready)
        slot = self._waiting[key]
        taken = Taken(key, slot.items.pop(0), slot.dropped)
        self._bytes -= self._size(taken.item)
        self._turn += 1
        slot.served, slot.dropped = self._turn, 0
        if slot.items:
            self._enlist(key, slot)
        else:
            self._retire(key, slot)
        return taken

    def __contains__(self, key: K) -> bool:
        return key in self._waiting

    def discard(self, key: K) -> list[T]:
        """Forget a key; return its waiting items, oldest first."""
        self._idle.pop(key, None)
        slot = self._waiting.pop(key, None)
        if slot is None:
            return []
        self._ready = [entry for entry in self._ready if entry[2] != key]
        heapq.heapify(self._ready)
        self._bytes -= sum(map(self._size, slot.items))
        return slot.items

    def _enlist(self, key: K, slot: _Slot[T]) -> None:
        self._arrival += 1
        heapq.heappush(self._ready, (slot.served, self._arrival, key))

    def _retire(self, key: K, slot: _Slot[T]) -> None:
        del self._waiting[key]
        self._idle[key] = slot.served
        if len(self._idle) > self._max_keys:
            self._idle.popitem(last=False)


class _Drops(Generic[K]):
    """How many items of each key were dropped since one was taken, of the MAX_KEYS that lost one last."""

    def __init__(self) -> None:
        self._of: OrderedDict[K, int] = OrderedDict()

    def note(self, key: K) -> None:
        self._of[key] = self._of.get(key, 0) + 1
        if len(self._of) > MAX_KEYS:
            self._of.popitem(last=False)

    def taken(self, key: K) -> int:
        """Return how many were dropped, and forget it."""
        return self._of.pop(key, 0)


@final
class Fifo(Generic[K, T]):
    """Keep the `depth` newest items in order of arrival, as far as they have `most_bytes` together; always the newest.

    size: the bytes of an item.
    """

    def __init__(self, depth: int, most_bytes: int = sys.maxsize, size: Callable[[T], int] = lambda _: 0) -> None:
        self._depth = depth
        self._most_bytes = most_bytes
        self._size = size
        self._bytes = 0
        self._items: deque[tuple[K, T]] = deque()
        self._drops = _Drops[K]()

    def offer(self, key: K, item: T) -> int:
        """Add an item; return how many of the oldest ones were dropped for it."""
        self._items.append((key, item))
        self._bytes += self._size(item)
        dropped = 0
        while len(self._items) > self._depth or (self._bytes > self._most_bytes and len(self._items) > 1):
            victim, old = self._items.popleft()
            self._bytes -= self._size(old)
            self._drops.note(victim)
            dropped += 1
        return dropped

    def take(self) -> Taken[K, T] | None:
        """Take the oldest item."""
        if not self._items:
            return None
        key, item = self._items.popleft()
        self._bytes -= self._size(item)
        return Taken(key, item, self._drops.taken(key))


OWNER_BYTES: Final = 400
"""Bytes that an owner's queue takes beside its items."""


@dataclass(slots=True, eq=False)
class _Link(Generic[K, T]):
    """An item, and that of the same owner which came next."""

    key: K
    item: T
    next: "_Link[K, T] | None" = None


@dataclass(slots=True, eq=False)
class _Share(Generic[K, T]):
    """One owner's waiting items, and their bytes. They are linked: of thousands of owners, a deque each is large."""

    oldest: _Link[K, T]
    newest: _Link[K, T]
    bytes: int = OWNER_BYTES


@final
class InTurn(Generic[K, T]):
    """Keep items as a Fifo does, but for each owner of keys by itself, so that none keeps others waiting.

    Owners are served in turn. Without room, one that has about the most bytes loses its oldest item.

    owner: of a key. size: the bytes of an item.
    """

    def __init__(self, depth: int, most_bytes: int, size: Callable[[T], int], owner: Callable[[K], K]) -> None:
        self._depth = depth
        self._most_bytes = most_bytes
        self._size = size
        self._owner = owner
        self._count = 0
        self._bytes = 0
        self._shares: OrderedDict[K, _Share[K, T]] = OrderedDict()
        self._by_magnitude: defaultdict[int, dict[K, None]] = defaultdict(dict)  # owners by their bytes' bit length
        self._drops = _Drops[K]()

    def offer(self, key: K, item: T) -> int:
        """Add an item; return how many were dropped for it."""
        owner = self._owner(key)
        share = self._shares.get(owner)
        link = _Link(key, item)
        if share is None:
            share = self._shares[owner] = _Share(link, link)
            self._bytes += share.bytes
            self._by_magnitude[share.bytes.bit_length()][owner] = None
        else:
            share.newest.next = link
            share.newest = link
        self._grow(owner, share, self._size(item))
        self._count += 1
        dropped = 0
        while (self._count > self._depth or self._bytes > self._most_bytes) and self._count > 1:
            largest = next(iter(self._by_magnitude[max(self._by_magnitude)]))
            victim, _ = self._pop(largest, self._shares[largest])
            self._drops.note(victim)
            dropped += 1
        return dropped

    def take(self) -> Taken[K, T] | None:
        """Take the oldest item of the owner that was served longest ago."""
        if not self._shares:
            return None
        owner = next(iter(self._shares))
        self._shares.move_to_end(owner)
        key, item = self._pop(owner, self._shares[owner])
        return Taken(key, item, self._drops.taken(key))

    def _pop(self, owner: K, share: _Share[K, T]) -> tuple[K, T]:
        link = share.oldest
        self._count -= 1
        self._grow(owner, share, -self._size(link.item))
        if link.next is None:
            self._bytes -= share.bytes
            self._leave(share.bytes.bit_length(), owner)
            del self._shares[owner]
        else:
            share.oldest = link.next
        return link.key, link.item

    def _grow(self, owner: K, share: _Share[K, T], by: int) -> None:
        before = share.bytes.bit_length()
        share.bytes += by
        self._bytes += by
        after = share.bytes.bit_length()
        if after != before:
            self._leave(before, owner)
            self._by_magnitude[after][owner] = None

    def _leave(self, magnitude: int, owner: K) -> None:
        owners = self._by_magnitude[magnitude]
        del owners[owner]
        if not owners:
            del self._by_magnitude[magnitude]
