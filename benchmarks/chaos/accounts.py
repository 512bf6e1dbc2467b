"""Class lists and alerts that were published, against those that the store holds. Pure."""

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
class Alerts:
    """Ids of alerts. before: at the store at the beginning. after: at the end, and whether each is open.

    told: those that subscribers were told of in between, and not before.
    """

    before: AbstractSet[str]
    after: Mapping[str, bool]
    told: AbstractSet[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Losses:
    """What is not at the store as it was published.

    alerts: how many there should be, one for each time that a pallet came into view. lost_alerts: how many fewer the
    store has; passed_alerts: of those, how many pallets had come and gone before the fleet was well again, at most.
    doubled_alerts: how many more there are, at the store or on the bus. unstored_alerts: those that were on the bus and
    are not at the store. stuck_alerts: those that are open although their pallet is gone, or the other way round.
    """

    lists: int
    lost_lists: int
    doubled_lists: int
    alerts: int
    lost_alerts: int
    passed_alerts: int
    doubled_alerts: int
    unstored_alerts: int
    stuck_alerts: int

    def figures(self) -> dict[str, int]:
        """Return what is printed."""
        return {
            "lost": self.lost_lists + self.lost_alerts + self.unstored_alerts,
            "doubled": self.doubled_lists + self.doubled_alerts,
            "lists": self.lists,
            "lost_lists": self.lost_lists,
            "doubled_lists": self.doubled_lists,
            "alerts": self.alerts,
            "lost_alerts": self.lost_alerts,
            "passed_alerts": self.passed_alerts,
            "doubled_alerts": self.doubled_alerts,
            "unstored_alerts": self.unstored_alerts,
            "stuck_alerts": self.stuck_alerts,
        }


@dataclass(frozen=True, slots=True)
class Window:
    """The time of a fault, until the fleet was well again. before: whether a pallet was in view at the beginning."""

    began_ns: int
    well_ns: int
    before: bool


def arrivals(published: Sequence[Published], *, before: bool) -> list[int]:
    """Return the places of the lists in which a pallet came into view."""
    views = [before, *(each.pallet for each in published)]
    return [place for place, (earlier, now) in enumerate(pairwise(views)) if now and not earlier]


def passed(published: Sequence[Published], window: Window) -> int:
    """Return how many pallets came and went between the beginning of a fault and when the fleet was well again."""
    found = 0
    for place in arrivals(published, before=window.before):
        gone_ns = next((each.received_ns for each in published[place:] if not each.pallet), None)
        came_ns = published[place].received_ns
        found += came_ns >= window.began_ns and gone_ns is not None and gone_ns <= window.well_ns
    return found


def missing(published: Iterable[Published], stored: Mapping[str, int]) -> list[str]:
    """Return the marks of lists that are not at the store. stored: how many rows each mark has."""
    return [each.mark for each in published if not stored.get(each.mark)]


def losses(
    published: Sequence[Published],
    stored: Mapping[str, int],
    alerts: Alerts,
    window: Window,
) -> Losses:
    """Compare what was published in some time with the store at its end. stored: rows of each mark."""
    marks = {each.mark for each in published}
    raised = len(arrivals(published, before=window.before))
    new = alerts.after.keys() - alerts.before
    lost = max(0, raised - len(new))
    in_view = published[-1].pallet if published else window.before
    return Losses(
        lists=len(published),
        lost_lists=len(missing(published, stored)),
        doubled_lists=sum(max(0, stored.get(mark, 0) - 1) for mark in marks),
        alerts=raised,
        lost_alerts=lost,
        passed_alerts=min(lost, passed(published, window)),
        doubled_alerts=max(0, len(new) - raised, len(alerts.told) - raised),
        unstored_alerts=len(alerts.told - alerts.after.keys()),
        stuck_alerts=abs(sum(alerts.after.values()) - in_view),
    )
