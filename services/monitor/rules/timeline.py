"""The history of a period as events in order, for replaying rules. Pure."""

from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Final

from schemas.keys import CameraKey
from services.monitor.history.interval_buffer import StoredInterval
from services.monitor.history.intervals import Disagreement, Interval
from services.monitor.history.presence import MONITOR, Presence
from services.monitor.inventory.inventory import TrustLimits

LIMITS: Final = TrustLimits()
"""The monitor's limits are not in the history; the defaults are assumed."""


class AvailablePeriods:
    """The periods in which one camera was available."""

    def __init__(self, presences: Iterable[Presence]) -> None:
        self._presences = sorted(presences, key=lambda each: each.since_ns)
        self._since_ns = [each.since_ns for each in self._presences]

    def lost_ns(self, interval: Interval) -> int | None:
        """Return when the camera was found silent, if that ended the interval; None if the object was seen to leave."""
        begun = bisect_right(self._since_ns, interval.until_ns)
        of = self._presences[begun - 1] if begun else None
        if of is None or of.heard_ns is None or interval.until_ns > of.until_ns:
            return None
        return of.until_ns if of.heard_ns < interval.until_ns + LIMITS.debounce.vanish_ns else None

    def was_there_first(self, interval: Interval) -> bool:
        """Whether the object was in view when the camera became available again after it was lost."""
        later = bisect_left(self._since_ns, interval.since_ns)
        if later in (0, len(self._presences)):
            return False
        before, after = self._presences[later - 1 : later + 1]
        return before.until_ns < interval.since_ns and after.since_ns - before.until_ns > LIMITS.lost_ns


NEVER: Final = AvailablePeriods(())


def available_periods(presences: Iterable[Presence]) -> Mapping[CameraKey, AvailablePeriods]:
    """Return the periods in which each camera was available."""
    of_each = defaultdict[CameraKey, list[Presence]](list)
    for each in presences:
        if each.camera:
            of_each[CameraKey(each.robot, each.camera)].append(each)
    return {key: AvailablePeriods(those) for key, those in of_each.items()}


FOREVER_NS: Final = 2**63 - 1


@dataclass(frozen=True, slots=True)
class Step:
    """The beginning or end of a period.

    unseen: it was not observed, because the camera was not available before, or since. of: None where a monitor knows
    the presence of all members, and checks them.
    """

    at_ns: int
    of: StoredInterval | None
    begins: bool = False
    unseen: bool = False


@dataclass(frozen=True, slots=True)
class Run:
    """A period in which one monitor raised alerts. told: it also recorded presence."""

    since_ns: int
    until_ns: int
    told: bool


@dataclass(frozen=True, slots=True)
class Timeline:
    """Sightings, presence and disagreements of a period."""

    intervals: Sequence[Interval] = ()
    presences: Sequence[Presence] = ()
    disagreements: Sequence[Disagreement] = ()

    @property
    def first_ns(self) -> int:
        """The earliest end of an interval in view; FOREVER_NS if there is none."""
        return min((interval.until_ns for interval in self.intervals), default=FOREVER_NS)

    @property
    def last_ns(self) -> int:
        """The time of the last entry; 0 if there is none."""
        everything = chain(self.intervals, self.presences, self.disagreements)
        return max((each.until_ns for each in everything), default=0)

    @property
    def told_ns(self) -> int:
        """The start of recorded presence; FOREVER_NS if there is none."""
        return min((each.since_ns for each in self.presences if each.place == MONITOR), default=FOREVER_NS)

    def runs(self) -> Iterator[Run]:
        """Yield the periods in which a monitor raised alerts; one is assumed before the first that is recorded."""
        yield Run(0, self.told_ns, told=False)
        runs = sorted((each for each in self.presences if each.place == MONITOR), key=lambda each: each.since_ns)
        next_ones_ns = [*(each.since_ns for each in runs), FOREVER_NS][1:]
        for each, next_ns in zip(runs, next_ones_ns, strict=True):
            yield Run(each.since_ns, next_ns if each.open else min(each.until_ns, next_ns), told=True)

    def steps(self) -> list[Step]:
        """Return all events except the monitors' own, in order; ends come before beginnings of the same moment."""
        return sorted(chain(self._seen(), self._known()), key=lambda step: (step.at_ns, step.begins))

    def _seen(self) -> Iterator[Step]:
        """Yield how what was in view came and went."""
        available = available_periods(self.presences)
        first_ns: dict[CameraKey, int] = {}
        for each in self.intervals:
            first_ns[each.key] = min(each.since_ns, first_ns.get(each.key, each.since_ns))
        began = {(each.place, each.since_ns) for each in self.intervals}
        for each in self.intervals:
            of = available.get(each.key, NEVER)
            unseen = each.since_ns == first_ns[each.key] or of.was_there_first(each)
            if each.open or each.until_ns > each.since_ns:
                yield Step(each.since_ns, each, begins=True, unseen=unseen)
                counted = (each.place, each.until_ns) in began
                lost_ns = None if counted else of.lost_ns(each)
                if not each.open:
                    yield Step(lost_ns or each.until_ns, each, unseen=lost_ns is not None)

    def _known(self) -> Iterator[Step]:
        """Yield the changes of presence, and of disagreements."""
        for each in chain(self.presences, self.disagreements):
            if each.place == MONITOR:
                continue
            if each.open or each.until_ns > each.since_ns:
                yield Step(each.since_ns, each, begins=True)
            if not each.open:
                yield Step(each.until_ns, each)
