"""When the next frame of a stream is to be expected, by the stamps of those before. Pure."""

from collections import deque
from collections.abc import Sequence
from itertools import accumulate, pairwise
from statistics import linear_regression, median_low
from typing import Final

KEPT: Final = 16
"""How many of the last frames it is told by: a stream that is slower or faster now is followed after these."""

AHEAD: Final = 8
"""For so many frames ahead it is told."""


class Rhythm:
    """The line through the last frames of a stream, some of which may have been lost.

    Stamps need not be even: depth often has the nearest ones of a faster stream.
    """

    def __init__(self) -> None:
        self._stamps: deque[int] = deque(maxlen=KEPT)
        self._line: tuple[int, int] | None = None

    def note(self, stamp_ns: int) -> None:
        """Take a frame's stamp; where it is not after the last one, nothing is known any more."""
        if self._stamps and stamp_ns <= self._stamps[-1]:
            self._stamps.clear()
        self._stamps.append(stamp_ns)
        self._line = None

    @property
    def interval_ns(self) -> int:
        """How far apart frames are, those among them that were lost; 0 while nobody knows."""
        return self._fitted()[1]

    def next_ns(self, since_ns: int) -> int | None:
        """Return when the first frame not before a time is to be expected; None where that is too far away to tell."""
        last_ns, interval_ns = self._fitted()
        if not interval_ns:
            return None
        frames = -((last_ns - since_ns) // interval_ns)
        return last_ns + frames * interval_ns if abs(frames) <= AHEAD else None

    def _fitted(self) -> tuple[int, int]:
        """Return where on the line the last frame is, and the interval."""
        if self._line is None:
            self._line = _fit(self._stamps) if len(self._stamps) > 1 else (0, 0)
        return self._line


def _fit(stamps: Sequence[int]) -> tuple[int, int]:
    gaps = [after - before for before, after in pairwise(stamps)]
    usual = median_low(gaps)
    places = list(accumulate((max(1, round(gap / usual)) for gap in gaps), initial=0))
    interval, first = linear_regression(places, [stamp - stamps[-1] for stamp in stamps])
    return stamps[-1] + round(first + places[-1] * interval), round(interval)
