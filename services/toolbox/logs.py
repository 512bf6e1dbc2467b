"""Logging of a process: one line an event on stderr, and no source can flood it."""

import logging
import sys
from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

FORMAT: Final = "%(asctime)s %(levelname)-7s %(name)s: %(message)s"
PERIOD_S: Final = 10.0
MAX_SOURCES: Final = 1_024


@dataclass(slots=True)
class _Window:
    opened: float
    held_back: int = 0


class RateLimit:
    """Lets one event per source through in each period and counts those held back; sources remembered are bounded."""

    def __init__(self, period_s: float = PERIOD_S, max_sources: int = MAX_SOURCES) -> None:
        self._period_s = period_s
        self._max_sources = max_sources
        self._windows: OrderedDict[tuple[object, ...], _Window] = OrderedDict()

    def admit(self, source: tuple[object, ...], now: float) -> int | None:
        """Return None to hold the event back, else how many were held back since the last one let through."""
        window = self._windows.get(source)
        if window is not None and now - window.opened < self._period_s:
            window.held_back += 1
            return None
        self._windows[source] = _Window(now)
        self._windows.move_to_end(source)
        if len(self._windows) > self._max_sources:
            self._windows.popitem(last=False)
        return window.held_back if window else 0


class RateLimitFilter(logging.Filter):
    """Applies a RateLimit to warnings and errors; an event's source is its logger, its text and its first argument."""

    def __init__(self, limit: RateLimit) -> None:
        super().__init__()
        self._limit = limit

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether the record is written, with the count of those held back before it."""
        if record.levelno < logging.WARNING:
            return True
        first = str(record.args[0]) if isinstance(record.args, tuple) and record.args else ""
        held_back = self._limit.admit((record.name, record.msg, first), record.created)
        if held_back:
            record.msg, record.args = f"{record.getMessage()} (and {held_back} more like it)", ()
        return held_back is not None


def configure(level: str) -> None:
    """Write records of `level` and above to stderr."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter(FORMAT))
    handler.addFilter(RateLimitFilter(RateLimit()))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)
    logging.getLogger("aiohttp.access").setLevel(logging.WARNING)
