"""How many were in view over time: intervals of the history into the points of a chart. Pure."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Final

from services.monitor.history.archive import Counted
from services.monitor.history.intervals import Interval
from services.monitor.page.formatting import NS

MAX_LINES: Final = 8
"""Classes in one chart; those with the most in view are shown."""

BUCKETS: Final = 360

Points = list[tuple[int, int]]
"""(milliseconds since the epoch, count), the oldest first; a count lasts until the next."""


def counts_over_time(intervals: Iterable[Interval | Counted], since_ns: int, until_ns: int) -> dict[str, Points]:
    """Return the points of each class, all cameras together, the class with the most first.

    Where more happened than a chart can show, a point is the most that were in view in its slot.
    """
    moves = defaultdict[str, list[tuple[int, int]]](list)
    for interval in intervals:
        begin, end = max(since_ns, interval.since_ns), until_ns if interval.open else interval.until_ns
        if interval.count and begin < min(end, until_ns):
            moves[interval.name].append((begin, interval.count))
            if end < until_ns:
                moves[interval.name].append((end, -interval.count))
    lines = {name: _slotted(_summed(of), since_ns, until_ns) for name, of in moves.items()}
    biggest = sorted(lines, key=lambda name: (-max(count for _, count in lines[name]), name))[:MAX_LINES]
    return {name: lines[name] for name in biggest}


def _summed(moves: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    at_once = defaultdict[int, int](int)
    for at_ns, by in moves:
        at_once[at_ns] += by
    count, summed = 0, []
    for at_ns in sorted(at_once):
        count += at_once[at_ns]
        summed.append((at_ns, count))
    return summed


def _slotted(steps: Sequence[tuple[int, int]], since_ns: int, until_ns: int) -> Points:
    """Return the steps from the beginning to the end, no more than two a slot: its most, and what it ends with."""
    width = max(1, (until_ns - since_ns) // BUCKETS)
    points: list[tuple[int, int]] = [(since_ns, 0)]
    slot, most, last = -1, (0, 0), (0, 0)
    for step in [*steps, (until_ns, steps[-1][1] if steps else 0)]:
        if (step[0] - since_ns) // width != slot:
            points += _ends(most, last) if slot >= 0 else []
            slot, most = (step[0] - since_ns) // width, step
        most, last = max(most, step, key=lambda each: each[1]), step
    points += _ends(most, last)
    return [(at_ns * 1_000 // NS, count) for at_ns, count in points]


def _ends(most: tuple[int, int], last: tuple[int, int]) -> list[tuple[int, int]]:
    return [most] if most == last else [most, last]
