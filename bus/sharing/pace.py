"""Controls the frame rate that a worker asks for, from the frames it processed and lost. Pure."""

from dataclasses import dataclass
from typing import Final

WINDOW_S: Final = 1.0
"""Shortest measuring window."""

FRAMES_PER_CAMERA: Final = 2
"""Frames of each camera in a window, if that takes no longer than LONGEST_S."""

MIN_FRAMES: Final = 10
"""Fewest frames that give a rate."""

LONGEST_S: Final = 5.0
"""Longest measuring window, whatever came in it."""

MUCH_LOST: Final = 0.1
"""A worker that loses a larger fraction of its frames cannot keep up."""

SOME_LOST: Final = 0.06
"""Above this fraction of lost frames the limit is too high."""

IDLE: Final = 0.06
"""Above this fraction of idle time the limit is too low, if no frames are lost."""

MUCH_IDLE: Final = 0.5
"""Above this fraction of idle time lost frames do not come from the limit."""

HEADROOM: Final = 0.95
"""Fraction of a saturated worker's rate that can be used with little waiting."""

UNUSED: Final = 0.5
"""A limit of which cameras use no larger fraction than this is dropped."""


@dataclass(frozen=True, slots=True)
class Totals:
    """Counts of a worker's frames since it started: processed, and lost to overload. busy_s: time spent on them.

    Losses of cameras that left may be forgotten.
    """

    done: int = 0
    lost: int = 0
    busy_s: float = 0.0


class Pace:
    """The joint rate of a worker's cameras that keeps it busy while few frames are sent in vain.

    There is none until frames are lost; it then follows what gets done, down when frames are lost, up when there is
    time left, and ends when the cameras send much less than they might. It falls no lower than what gets done: frames
    that another consumer asked for are lost here whatever the limit.
    """

    def __init__(self) -> None:
        self.limit_hz: float | None = None
        self._since_s: float | None = None
        self._before = Totals()

    def look(self, totals: Totals, cameras: int, now_s: float) -> bool:
        """Update from the totals; return whether the limit changed. Call a few times a second."""
        if self._since_s is None:
            self._begin(totals, now_s)
            return False
        spent_s = now_s - self._since_s
        done, lost = totals.done - self._before.done, max(0, totals.lost - self._before.lost)
        turns_s = FRAMES_PER_CAMERA * cameras / self.limit_hz if self.limit_hz else 0.0
        if spent_s < LONGEST_S and (spent_s < max(WINDOW_S, turns_s) or done < MIN_FRAMES):
            return False
        busy_s = min(spent_s, totals.busy_s - self._before.busy_s)
        before = self.limit_hz
        if done and busy_s > 0:
            lost_part = lost / (done + lost)
            if before is None:
                self.limit_hz = done / busy_s * HEADROOM if lost_part > MUCH_LOST else None
            else:
                self.limit_hz = _next(before, done / spent_s, lost_part, idle=1 - busy_s / spent_s)
        self._begin(totals, now_s)
        return self.limit_hz != before

    def _begin(self, totals: Totals, now_s: float) -> None:
        self._before, self._since_s = totals, now_s


def _next(limit: float, done_hz: float, lost: float, idle: float) -> float | None:
    if lost > SOME_LOST and idle < MUCH_IDLE:
        return max(limit * (1 - lost / 2), done_hz * HEADROOM)
    if idle > MUCH_IDLE or (idle > IDLE and lost < SOME_LOST / 2):
        return None if done_hz < limit * UNUSED else limit * (1 + idle / 2)
    return limit
