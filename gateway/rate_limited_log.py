"""A log that what happens thirty times a second does not flood."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

EVERY_S: Final = 30.0


@dataclass(slots=True)
class _Said:
    at_s: float
    unsaid: int = 0


class RateLimitedLog:
    """Warns of each kind of thing at most once in EVERY_S seconds, and says how often it did not.

    A kind is the text of a message before its arguments are filled in.
    """

    def __init__(self, log: logging.Logger, clock: Callable[[], float] = time.monotonic) -> None:
        self._log = log
        self._clock = clock
        self._said: dict[str, _Said] = {}

    def warning(self, text: str, *arguments: object) -> None:
        """Log a warning, or only count it."""
        now_s = self._clock()
        last = self._said.get(text)
        if last is not None and now_s - last.at_s < EVERY_S:
            last.unsaid += 1
            return
        self._said[text] = _Said(now_s)
        if last is not None and last.unsaid:
            self._log.warning(f"{text} (and %d more since the last such line)", *arguments, last.unsaid)
        else:
            self._log.warning(text, *arguments)
