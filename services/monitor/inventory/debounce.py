"""Debouncing: how many class lists, and how long, make something count as there, or gone. Pure."""

from dataclasses import dataclass

from services.monitor.inventory.sighting import NS


@dataclass(frozen=True, slots=True)
class Debounce:
    """The number of consecutive class lists, and the time, for which more (or fewer) must show to move the count."""

    appear_lists: int = 2
    appear_ns: int = 0
    vanish_lists: int = 2
    vanish_ns: int = NS


class DebouncedCount:
    """The number of objects of one class in view; it follows only consistent lists.

    While lists in a row say more than `count`, the least that they all say is taken once they are enough; the same
    the other way round. since_ns: when the first of the lists that moved `count` last came.
    """

    __slots__ = ("_bound", "_lists", "_run_ns", "count", "since_ns")

    def __init__(self, count: int = 0) -> None:
        self.count = count
        self.since_ns = 0
        self._lists = 0
        self._bound = 0
        self._run_ns = 0

    def advance(self, seen: int, at_ns: int, debounce: Debounce) -> bool:
        """Take the count in the list of `at_ns`; return whether `count` changed."""
        if seen == self.count:
            self._lists = 0
            return False
        above = seen > self.count
        if self._lists and above == (self._bound > self.count) and at_ns >= self._run_ns:
            self._lists += 1
            self._bound = min(self._bound, seen) if above else max(self._bound, seen)
        else:
            self._begin(seen, at_ns)
        lists, long_ns = (
            (debounce.appear_lists, debounce.appear_ns) if above else (debounce.vanish_lists, debounce.vanish_ns)
        )
        if self._lists < lists or at_ns - self._run_ns < long_ns:
            return False
        self.count, self.since_ns, self._lists = self._bound, self._run_ns, 0
        if seen != self.count:
            self._begin(seen, at_ns)
        return True

    def _begin(self, seen: int, at_ns: int) -> None:
        self._lists, self._bound, self._run_ns = 1, seen, at_ns
