"""Which of a camera's frames are enough for who need not see all of them. Pure."""

from typing import Final

SECOND_NS: Final = 1_000_000_000

EARLY: Final = 0.3
"""By how much of a turn a frame may come too early: they are not evenly spaced."""


class Sparing:
    """Passes about so many frames a second, all of them for None."""

    def __init__(self, most_hz: float | None) -> None:
        self._apart_ns = 0 if most_hz is None else round((1 - EARLY) * SECOND_NS / most_hz)
        self._last_ns: int | None = None

    def passes(self, arrived_ns: int) -> bool:
        """Return whether a frame is looked at that arrived then, by a clock that may be set back."""
        if self._last_ns is not None and 0 <= arrived_ns - self._last_ns < self._apart_ns:
            return False
        self._last_ns = arrived_ns
        return True
