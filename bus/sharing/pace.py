"""How many frames a second a worker can use, by what became of those it got. Pure."""

from dataclasses import dataclass
from typing import Final

WINDOW_S: Final = 1.0
"""For how long what became of frames is watched, at least."""

TURNS: Final = 2
"""How often each camera had its turn by then, if that takes no longer than LONGEST_S."""

FEWEST: Final = 10
"""Frames that say something about a rate."""

LONGEST_S: Final = 5.0
"""A window that is so long says something whatever came."""

MUCH_LOST: Final = 0.1
"""Of its frames this much is lost at a worker that cannot keep up."""

SOME_LOST: Final = 0.06
"""More lost frames than this make a limit too high."""

IDLE: Final = 0.06
"""More idle time than this makes a limit too low, if no frames are lost."""

MUCH_IDLE: Final = 0.5
"""With more idle time than this it is not the limit that loses frames."""

HEADROOM: Final = 0.95
"""Of the rate at which a worker worked when it was flooded this much can be used with little waiting."""

UNUSED: Final = 0.5
"""A limit of which no more than this is used by cameras is none."""


@dataclass(frozen=True, slots=True)
class Totals:
    """What became of a worker's frames since it started: looked at, or too many for it. busy_s: time spent on them.

    What cameras that left had lost may be forgotten.
    """

    done: int = 0
    lost: int = 0
    busy_s: float = 0.0


class Pace:
    """The rate for all of a worker's cameras together that keeps it busy while few frames are sent in vain.

    There is none until frames are lost; it then follows what gets done, down when frames are lost, up when there is
    time left, and ends when the cameras send much less than they might. It falls no lower than what gets done: frames
    that another consumer asked for are lost here whatever the limit.
    """

    def __init__(self) -> None:
        self.limit_hz: float | None = None
        self._since_s: float | None = None
        self._before = Totals()

    def look(self, totals: Totals, cameras: int, now_s: float) -> bool:
        """Take in what became of frames; return whether the limit changed. To be called a few times a second."""
        if self._since_s is None:
            self._begin(totals, now_s)
            return False
        spent_s = now_s - self._since_s
        done, lost = totals.done - self._before.done, max(0, totals.lost - self._before.lost)
        turns_s = TURNS * cameras / self.limit_hz if self.limit_hz else 0.0
        if spent_s < LONGEST_S and (spent_s < max(WINDOW_S, turns_s) or done < FEWEST):
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
