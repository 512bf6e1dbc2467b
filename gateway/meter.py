"""Rates out of counts. Pure."""

from collections import deque
from typing import Final

SPAN_NS: Final = 5_000_000_000
READINGS: Final = 64


class Meter:
    """Tells how fast a count grew over the last seconds, from the readings that were taken of it."""

    def __init__(self) -> None:
        self._readings: deque[tuple[int, int]] = deque(maxlen=READINGS)

    def hz(self, count: int, now_ns: int) -> float:
        """Take a reading; return how much the count grew a second since the newest reading that is SPAN_NS old.

        While there is none, since the first one, which says 0; the clock going back starts over.
        """
        if self._readings and now_ns < self._readings[-1][0]:
            self._readings.clear()
        self._readings.append((now_ns, count))
        while len(self._readings) > 2 and now_ns - self._readings[1][0] >= SPAN_NS:
            self._readings.popleft()
        then_ns, before = self._readings[0]
        return max(0, count - before) * 1e9 / (now_ns - then_ns) if now_ns > then_ns else 0.0
