"""How many were in view over time: counts of the history into the points of a chart. Pure."""

from collections.abc import Iterator, Mapping
from typing import Final

from services.monitor.history.counting import Counts
from services.monitor.page.formatting import NS

MAX_LINES: Final = 8
"""Classes in one chart; those with the most in view are shown."""

Points = list[tuple[int, int | None]]
"""(milliseconds since the epoch, count), the oldest first; a count lasts until the next. None: nobody knows it."""


def counts_over_time(counts: Counts) -> dict[str, Points]:
    """Return the points of each class, all cameras together, the class with the most first."""
    biggest = sorted(counts.most, key=lambda name: (-max(counts.most[name].values(), default=0), name))
    return {name: list(_points(counts, counts.most[name])) for name in biggest[:MAX_LINES]}


def _points(counts: Counts, most: Mapping[int, int]) -> Iterator[tuple[int, int | None]]:
    """Yield a point wherever the count changes, or is not known any more, and one for the end."""
    slots, before, number = counts.slots, object(), counts.slots.number
    for slot in range(number):
        count = most.get(slot, 0) if slot in counts.known else None
        if count != before:
            yield (slots.since_ns + slot * slots.width_ns) * 1_000 // NS, count
        before = count
    yield slots.until_ns * 1_000 // NS, most.get(number - 1, 0) if number - 1 in counts.known else None
