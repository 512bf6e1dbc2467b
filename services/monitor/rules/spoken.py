"""When cameras were spoken for, and so what nobody saw come or go. Pure."""

from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Final

from schemas.keys import CameraKey
from services.monitor.history.intervals import Interval
from services.monitor.history.presence import Presence
from services.monitor.inventory.inventory import Limits

LIMITS: Final = Limits()
"""Those of the monitor are not kept; it is taken to have had the usual ones."""


class Spoken:
    """When one camera was spoken for."""

    def __init__(self, presences: Iterable[Presence]) -> None:
        self._presences = sorted(presences, key=lambda each: each.since_ns)
        self._since_ns = [each.since_ns for each in self._presences]

    def lost_ns(self, interval: Interval) -> int | None:
        """Return when the camera was thought silent with which an interval ended; None if it ended before its eyes."""
        begun = bisect_right(self._since_ns, interval.until_ns)
        of = self._presences[begun - 1] if begun else None
        if of is None or of.heard_ns is None or interval.until_ns > of.until_ns:
            return None
        return of.until_ns if of.heard_ns < interval.until_ns + LIMITS.debounce.vanish_ns else None

    def was_there_first(self, interval: Interval) -> bool:
        """Whether it was in view when the camera spoke again after it was lost."""
        later = bisect_left(self._since_ns, interval.since_ns)
        if later in (0, len(self._presences)):
            return False
        before, after = self._presences[later - 1 : later + 1]
        return before.until_ns < interval.since_ns and after.since_ns - before.until_ns > LIMITS.lost_ns


NEVER: Final = Spoken(())


def spoken_for(presences: Iterable[Presence]) -> Mapping[CameraKey, Spoken]:
    """Return when each camera was spoken for."""
    of_each = defaultdict[CameraKey, list[Presence]](list)
    for each in presences:
        if each.camera:
            of_each[CameraKey(each.robot, each.camera)].append(each)
    return {key: Spoken(those) for key, those in of_each.items()}
