"""Class lists and alerts that were published, against those that the store holds. Pure."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Self

MARK: Final = "list-"
"""What the class begins with that tells a class list from all others."""

PALLET: Final = "pallet"


@dataclass(frozen=True, slots=True)
class Published:
    """A class list that a worker handed to the bus. received_ns: when the gateway had its frame. pallet: in view."""

    mark: str
    received_ns: int
    pallet: bool

    def line(self) -> str:
        """Return its line in a journal."""
        return f"{self.mark} {self.received_ns} {int(self.pallet)}\n"

    @classmethod
    def read(cls, line: str) -> Self:
        """Read a line of a journal.

        Raises:
            ValueError: it is none.
        """
        mark, received_ns, pallet = line.split()
        return cls(mark, int(received_ns), pallet == "1")


@dataclass(frozen=True, slots=True)
class Losses:
    """What is not at the store as it was published. lost, doubled: class lists and alerts.

    stuck: alerts that are open although their condition is over, or closed although it holds.
    """

    lists: int
    lost_lists: int
    doubled_lists: int
    alerts: int
    lost_alerts: int
    doubled_alerts: int
    stuck_alerts: int

    def figures(self) -> dict[str, int]:
        """Return what is printed."""
        return {
            "lost": self.lost_lists + self.lost_alerts,
            "doubled": self.doubled_lists + self.doubled_alerts,
            "lists": self.lists,
            "lost_lists": self.lost_lists,
            "doubled_lists": self.doubled_lists,
            "alerts": self.alerts,
            "lost_alerts": self.lost_alerts,
            "doubled_alerts": self.doubled_alerts,
            "stuck_alerts": self.stuck_alerts,
        }


def arrivals(published: Sequence[Published], *, before: bool) -> int:
    """Return how often a pallet came into view. before: whether one was in view before the first list."""
    views = [before, *(each.pallet for each in published)]
    return sum(now and not earlier for earlier, now in pairwise(views))


def missing(published: Iterable[Published], stored: Mapping[str, int]) -> list[str]:
    """Return the marks of lists that are not at the store. stored: how many rows each mark has."""
    return [each.mark for each in published if not stored.get(each.mark)]


def losses(
    published: Sequence[Published],
    stored: Mapping[str, int],
    before: AbstractSet[str],
    after: Mapping[str, bool],
    *,
    pallet_before: bool,
) -> Losses:
    """Compare what was published in some time with the store at its end.

    stored: rows of each mark. before: ids of the alerts at the beginning. after: those at the end, and whether each is
    open. pallet_before: whether a pallet was in view at the beginning.
    """
    marks = Counter(each.mark for each in published)
    raised = arrivals(published, before=pallet_before)
    came = len(after.keys() - before)
    in_view = published[-1].pallet if published else pallet_before
    return Losses(
        lists=len(published),
        lost_lists=len(missing(published, stored)),
        doubled_lists=sum(max(0, stored.get(mark, 0) - 1) for mark in marks),
        alerts=raised,
        lost_alerts=max(0, raised - came),
        doubled_alerts=max(0, came - raised),
        stuck_alerts=abs(sum(after.values()) - in_view),
    )
