"""Joins two streams by stamp: one is kept until messages of the other arrive."""

from bisect import bisect_left
from collections import Counter, deque
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from services.geometry.memory_budget import CROWDED, MemoryBudget

T = TypeVar("T")

KEEP_NS: Final = 2_000_000_000
ITEM_BYTES: Final = 1024
"""The approximate overhead of an item besides its data."""

JUMP_NS: Final = 1_000_000_000
"""Stamps that go back by more than this are of a clock that jumped: kept items are of another round."""

UNKNOWN_PERIOD_NS: Final = 33_333_333
LONGEST_PERIOD_NS: Final = 200_000_000
_PERIODS: Final = 15

SOON_NS: Final = 200_000_000
"""Nearer items are not waited for if they are still farther off than this."""

UNUSED: Final = "nothing of its instant was asked for"
FLUSHED: Final = "kept when the clock jumped back"
DOUBLE: Final = "a stamp that is there already"


@dataclass(frozen=True, slots=True)
class Partner(Generic[T]):
    """The matching item and its stamp. final: no nearer one can arrive."""

    item: T
    stamp_ns: int
    final: bool = True


@dataclass(frozen=True, slots=True)
class NoPartner:
    """Why no item matches. final: none can still arrive."""

    reason: str
    final: bool


@dataclass(slots=True)
class _Kept(Generic[T]):
    stamp_ns: int
    item: T
    size: int
    used: bool = False


class Joiner(Generic[T]):
    """Keeps a stream's newest items by stamp, bounded in time and memory, and finds the one of an instant.

    what: names an item in reasons, like "depth image". tolerance_ns: how far apart the stamps of one instant may be;
    None is half of the kept stream's own period, which is measured. budget: what it may share with others. dropped:
    items that left without having been found, by reason.
    """

    def __init__(
        self, what: str, *, tolerance_ns: int | None = None, keep_ns: int = KEEP_NS, budget: MemoryBudget | None = None
    ) -> None:
        self._what = what
        self._given_ns = tolerance_ns
        self._keep_ns = keep_ns
        self._budget = budget or MemoryBudget()
        self._kept: list[_Kept[T]] = []
        self._bytes = 0
        self._periods: deque[int] = deque(maxlen=_PERIODS)
        self.dropped: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def tolerance_ns(self) -> int:
        """The current maximum difference between the stamps of one instant."""
        if self._given_ns is not None:
            return self._given_ns
        return min(self._period_ns or UNKNOWN_PERIOD_NS, LONGEST_PERIOD_NS) // 2

    @property
    def _period_ns(self) -> int | None:
        return sorted(self._periods)[len(self._periods) // 2] if self._periods else None

    def keep(self, stamp_ns: int, item: T, size: int) -> None:
        """Add an item with `size` bytes of data; if there is no room, the oldest items go, here or at other holders."""
        newest = self._kept[-1].stamp_ns if self._kept else stamp_ns
        if stamp_ns < newest - JUMP_NS:
            self._leave(len(self._kept), FLUSHED)
            self._periods.clear()
        elif stamp_ns > newest:
            self._periods.append(stamp_ns - newest)
        place = bisect_left(self._kept, stamp_ns, key=lambda kept: kept.stamp_ns)
        if place < len(self._kept) and self._kept[place].stamp_ns == stamp_ns:
            self.dropped[DOUBLE] += 1
            self._bytes -= self._kept.pop(place).size
        self._kept.insert(place, _Kept(stamp_ns, item, size + ITEM_BYTES))
        self._bytes += size + ITEM_BYTES
        old = bisect_left(self._kept, self._kept[-1].stamp_ns - self._keep_ns, key=lambda kept: kept.stamp_ns)
        self._leave(old, UNUSED)
        self._budget.settle()

    def find(self, stamp_ns: int) -> Partner[T] | NoPartner:
        """Return the item nearest to a stamp so far, or why there is none; the item stays."""
        place = bisect_left(self._kept, stamp_ns, key=lambda kept: kept.stamp_ns)
        may_come = place == len(self._kept)
        around = self._kept[max(0, place - 1) : place + 1]
        best = min(around, key=lambda kept: abs(kept.stamp_ns - stamp_ns), default=None)
        if best is not None and abs(best.stamp_ns - stamp_ns) <= self.tolerance_ns:
            best.used = True
            nearer = may_come and self._nearer_comes(stamp_ns - best.stamp_ns)
            return Partner(best.item, best.stamp_ns, final=not nearer)
        return self._missing(best, stamp_ns, may_come=may_come)

    def shed(self) -> None:
        """Drop the oldest item."""
        self._leave(1, CROWDED)

    def flush(self) -> None:
        """Forget everything: the clock has changed."""
        self._leave(len(self._kept), FLUSHED)
        self._periods.clear()

    def _nearer_comes(self, ahead_ns: int) -> bool:
        """Return whether the next item may soon be nearer to a stamp this far ahead of the newest."""
        period = self._period_ns
        if period is None:
            return self._given_ns is not None  # a default tolerance is already half a period
        return 2 * ahead_ns > period and period - ahead_ns <= SOON_NS

    def _missing(self, nearest: _Kept[T] | None, stamp_ns: int, *, may_come: bool) -> NoPartner:
        if nearest is None:
            return NoPartner(f"no {self._what} arrived", final=False)
        apart_s = (nearest.stamp_ns - stamp_ns) / 1e9
        side = "after" if apart_s > 0 else "before"
        reason = f"no {self._what} of its instant: the nearest is {abs(apart_s):.3f} s {side} it"
        return NoPartner(reason, final=not may_come)

    def _leave(self, count: int, reason: str) -> None:
        for kept in self._kept[:count]:
            self._bytes -= kept.size
            if not kept.used:
                self.dropped[reason] += 1
        del self._kept[:count]
        self._budget.hold(self, self._bytes)
