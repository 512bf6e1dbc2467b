"""Which outputs make a set, and how old it is when it is whole. Pure.

A set is every output of one image. Where outputs say of which image they are, they count for that one; the guide's do
not, and count for the newest image that was sent before them, so that its sets are never taken for fewer or older than
they are.
"""

import statistics
from bisect import bisect_right
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

MS: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Arrival:
    """A message at its subscriber. stamp_ns: of the image that it is of, 0 if it does not say. size: bytes."""

    topic: str
    at_ns: int
    stamp_ns: int
    size: int


def complete(arrivals: Iterable[Arrival], topics: Collection[str]) -> int:
    """Return how many sets are whole: images that all outputs with stamps have, but no more than of any without."""
    counts: Counter[str] = Counter()
    frames: dict[str, set[int]] = {}
    for each in arrivals:
        if each.stamp_ns:
            frames.setdefault(each.topic, set()).add(each.stamp_ns)
        else:
            counts[each.topic] += 1
    known = [set.intersection(*frames.values())] if frames else []
    return min([counts[topic] for topic in topics if topic not in frames] + [len(each) for each in known], default=0)


def ages_ms(arrivals: Iterable[Arrival], topics: Collection[str], stamps: Sequence[int]) -> list[float]:
    """Return from each image's stamp to the last output of its set, of those sets that are whole.

    stamps: of the images that were sent, in order.
    """
    lasts: dict[int, dict[str, int]] = {stamp: {} for stamp in stamps}
    for each in arrivals:
        stamp = each.stamp_ns or _newest(stamps, each.at_ns)
        if stamp is not None and stamp in lasts:
            lasts[stamp][each.topic] = max(each.at_ns, lasts[stamp].get(each.topic, 0))
    whole = ((stamp, last.values()) for stamp, last in lasts.items() if all(topic in last for topic in topics))
    return [(max(last) - stamp) * MS for stamp, last in whole]


def _newest(stamps: Sequence[int], at_ns: int) -> int | None:
    at = bisect_right(stamps, at_ns)
    return stamps[at - 1] if at else None


def mean_sizes(arrivals: Iterable[Arrival]) -> dict[str, int]:
    """Return the mean bytes of a message, by topic."""
    sizes: dict[str, list[int]] = {}
    for each in arrivals:
        sizes.setdefault(each.topic, []).append(each.size)
    return {topic: round(statistics.mean(found)) for topic, found in sizes.items()}
