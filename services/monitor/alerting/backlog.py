"""The queue of alert changes waiting for one webhook. Pure."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Final

from schemas.alerts import Alert, AlertState

MAX_WAITING: Final = 10_000
"""How many changes, or alerts, wait for one webhook."""

DROPPED_SHARE: Final = 10
"""One part in so many is dropped at once where more would wait: looking for what to drop takes long."""

ALONE_AFTER: Final = 2
"""Failures, with posts that were answered well in between, after which an alert is left out of groups."""

Key = tuple[str, int]


@dataclass(slots=True)
class _Failures:
    """How often a change failed alone, with others done in between. done: how many were when it did so last."""

    count: int
    done: int


class Backlog:
    """Every change of alerts, in order; once folded, of each alert the newest change alone, until it is empty.

    changes: how often what waits has changed.
    """

    def __init__(self) -> None:
        self._waiting: dict[Key, Alert] = {}
        self._newest: dict[str, Key] = {}
        self._failures: dict[Key, _Failures] = {}
        self._done = 0
        self._newest_only = False
        self.is_folded = False
        self.changes = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def __contains__(self, alert: Alert) -> bool:
        return (alert.id, alert.changed_ns) in self._waiting

    def put(self, alert: Alert) -> int:
        """Queue a change; return how many changes were dropped for it, those of resolved alerts first."""
        key = (alert.id, alert.changed_ns)
        if self._newest_only and (before := self._newest.get(alert.id)) is not None:
            self._forget(before)
        self._waiting[key], self._newest[alert.id] = alert, key
        self.changes += 1
        if len(self._waiting) > MAX_WAITING:
            self._leave_newest()
        return self._drop() if len(self._waiting) > MAX_WAITING else 0

    def fold(self) -> None:
        """Keep only the newest change of each alert, also of later ones."""
        self._leave_newest()
        self.is_folded = True

    def newest(self) -> Iterator[Alert]:
        """Yield each waiting alert in its current state."""
        return (self._waiting[key] for key in self._newest.values())

    def first(self, count: int) -> list[Alert]:
        """Return those that wait longest, without those that failed alone; one of these once no others wait."""
        fewer = 1 if count == 1 else ALONE_AFTER
        fit = (each for key, each in self._waiting.items() if self._count(key) < fewer)
        return list(islice(fit, count)) or list(islice(self._waiting.values(), 1))

    def put_off(self, alert: Alert) -> int:
        """Have a change that failed alone wait behind all others; return how often that was so with others done since.

        It is 0 where none were done since it failed last: it may be the webhook that fails.
        """
        key = (alert.id, alert.changed_ns)
        if key not in self._waiting:
            return 0
        self._waiting[key] = self._waiting.pop(key)
        failures = self._failures.setdefault(key, _Failures(0, -1))
        if failures.done == self._done:
            return 0
        failures.count, failures.done = failures.count + 1, self._done
        return failures.count

    def done(self, alerts: Iterable[Alert]) -> None:
        """Remove changes that were posted."""
        for alert in alerts:
            self._forget((alert.id, alert.changed_ns))
            self._done += 1
        self._unfold_if_empty()

    def clear(self) -> None:
        """Forget everything."""
        self.changes += bool(self._waiting)
        self._waiting.clear()
        self._newest.clear()
        self._failures.clear()
        self._unfold_if_empty()

    def _count(self, key: Key) -> int:
        failures = self._failures.get(key)
        return 0 if failures is None else failures.count

    def _drop(self) -> int:
        some = sorted(self._waiting.values(), key=lambda each: each.state is not AlertState.RESOLVED)
        dropped = len(some) - (MAX_WAITING - MAX_WAITING // DROPPED_SHARE)
        for alert in some[:dropped]:
            self._forget((alert.id, alert.changed_ns))
        return dropped

    def _forget(self, key: Key) -> None:
        self._waiting.pop(key, None)
        self._failures.pop(key, None)
        if self._newest.get(key[0]) == key:
            del self._newest[key[0]]
        self.changes += 1

    def _unfold_if_empty(self) -> None:
        self.is_folded = self.is_folded and bool(self._waiting)
        self._newest_only = self._newest_only and bool(self._waiting)

    def _leave_newest(self) -> None:
        self._newest_only = True
        self._waiting = {key: each for key, each in self._waiting.items() if self._newest[each.id] == key}
        self._failures = {key: each for key, each in self._failures.items() if key in self._waiting}
