"""Which of a camera's frames are enough for who need not see all of them. Pure."""

from typing import Final

SECOND_NS: Final = 1_000_000_000

EARLY: Final = 0.3
"""By how much of a turn a frame may come too early: they are not evenly spaced."""


class Sparing:
    """Passes so many frames a second, as far as there are so many; all of them for None."""

    def __init__(self, most_hz: float | None) -> None:
        self._turn_ns = 0 if most_hz is None else round(SECOND_NS / most_hz)
        self._due_ns: int | None = None

    def passes(self, arrived_ns: int) -> bool:
        """Return whether a frame is looked at that arrived then, by a clock that may be set back."""
        due_ns = arrived_ns if self._due_ns is None else self._due_ns
        early_ns, soon_ns = due_ns - arrived_ns, EARLY * self._turn_ns
        if soon_ns < early_ns <= self._turn_ns + soon_ns:
            return False
        gap = early_ns > soon_ns or early_ns < -self._turn_ns  # the clock was set back, or no frames came for a while
        self._due_ns = (arrived_ns if gap else due_ns) + self._turn_ns  # one that is late does not delay the next
        return True
