"""Keeps a misbehaving peer from filling the log."""

from __future__ import annotations

import logging


class LogRate:
    """Says at which level to log: a warning at most `burst` times in `period` seconds, else debug."""

    def __init__(self, *, burst: int = 10, period: float = 60.0) -> None:
        self._burst = burst
        self._period = period
        self._since = float("-inf")
        self._count = 0

    def level(self, now: float) -> int:
        """Return the level of a line that is logged at `now`, in seconds of a steady clock."""
        if now - self._since >= self._period:
            self._since, self._count = now, 0
        self._count += 1
        return logging.WARNING if self._count <= self._burst else logging.DEBUG
