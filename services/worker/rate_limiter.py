"""Limits the rate of a camera's frames for consumers that need not see all of them. Pure."""

from typing import Final

SECOND_NS: Final = 1_000_000_000

EARLY: Final = 0.3
"""Share of the interval by which a frame may come too early: frames are not evenly spaced."""


class RateLimiter:
    """Passes frames at the requested rate, while there is a request and there are enough frames."""

    def __init__(self) -> None:
        self._asked: tuple[float, int] | None = None
        self._due_ns = 0
        self._soon_ns = 0.0

    def passes(self, arrived_ns: int, hz: float, from_ns: int) -> bool:
        """Return whether a frame with this arrival time passes, by a clock that may be set back.

        hz, from_ns: what was asked for last, and when the first was wanted: at most a turn after it was asked for.
        """
        if (hz, from_ns) != self._asked:  # cameras have assigned turns: no frame may take another camera's early
            self._asked, self._due_ns, self._soon_ns = (hz, from_ns), from_ns, 0.0
        turn_ns = round(SECOND_NS / hz)
        early_ns = self._due_ns - arrived_ns
        if self._soon_ns < early_ns <= turn_ns + self._soon_ns:
            return False
        gap = early_ns > self._soon_ns or early_ns < -turn_ns  # the clock was set back, or no frames came for a while
        self._due_ns = (arrived_ns if gap else self._due_ns) + turn_ns  # a late frame does not delay the next
        self._soon_ns = EARLY * turn_ns
        return True
