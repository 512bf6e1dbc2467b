"""The queue of alert changes waiting for one webhook. Pure."""

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Final

from schemas.alerts import Alert, AlertState

MAX_WAITING: Final = 10_000
"""How many changes, or alerts, wait for one webhook."""

Key = tuple[str, int]


class Backlog:
    """Alert changes in order; once folded, only the newest change of each alert, until it is empty."""

    def __init__(self) -> None:
        self._waiting: dict[Key, Alert] = {}
        self._newest: dict[str, Key] = {}
        self.is_folded = False

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, alert: Alert) -> int:
        """Queue a change; return how many changes were dropped for it, those of resolved alerts first."""
        key = (alert.id, alert.changed_ns)
        if self.is_folded and alert.id in self._newest:
            self._waiting.pop(self._newest[alert.id], None)
        self._waiting[key], self._newest[alert.id] = alert, key
        if len(self._waiting) > MAX_WAITING:
            self._leave_newest()
        dropped = 0
        while len(self._waiting) > MAX_WAITING:
            over = (each for each in self._waiting.values() if each.state is AlertState.RESOLVED)
            self.done([next(over, next(iter(self._waiting.values())))])
            dropped += 1
        return dropped

    def fold(self) -> None:
        """Keep only the newest change of each alert, also of later ones."""
        self._leave_newest()
        self.is_folded = True

    def newest(self) -> Iterator[Alert]:
        """Yield each waiting alert in its current state."""
        return (self._waiting[key] for key in self._newest.values())

    def first(self, count: int) -> list[Alert]:
        """Return the changes that have waited longest."""
        return list(islice(self._waiting.values(), count))

    def done(self, alerts: Iterable[Alert]) -> None:
        """Remove changes that were posted."""
        for alert in alerts:
            key = (alert.id, alert.changed_ns)
            self._waiting.pop(key, None)
            if self._newest.get(alert.id) == key:
                del self._newest[alert.id]
        self.is_folded = self.is_folded and bool(self._waiting)

    def clear(self) -> None:
        """Remove all changes."""
        self._waiting.clear()
        self._newest.clear()
        self.is_folded = False

    def _leave_newest(self) -> None:
        self._waiting = {key: each for key, each in self._waiting.items() if self._newest[each.id] == key}
