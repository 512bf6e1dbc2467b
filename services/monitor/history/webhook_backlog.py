"""Persists alerts that webhooks have not accepted yet, so that a restart loses none."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

from schemas.alerts import Alert
from services.monitor.history.store import Store


class WebhookBacklog(Protocol):
    """Posts alerts to webhooks, each by its name in the rule file."""

    def owe(self, alerts: Iterable[tuple[str, Alert]]) -> None:
        """Take the alerts that were not accepted before a restart."""

    def owed(self) -> Iterator[tuple[str, Alert]]:
        """Yield the alerts that have not been accepted yet."""

    def owed_changes(self) -> int:
        """Return how often these have changed."""


class NoBacklog:
    """An empty backlog."""

    def owe(self, alerts: Iterable[tuple[str, Alert]]) -> None:
        """Ignore the alerts."""

    def owed(self) -> Iterator[tuple[str, Alert]]:
        """Yield nothing."""
        return iter(())

    def owed_changes(self) -> int:
        """Never."""
        return 0


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The backlog after so many changes. owed: alerts by webhook name and id."""

    changes: int
    owed: Mapping[tuple[str, str], Alert]


class BacklogWriter:
    """Writes changes of the backlog."""

    def __init__(self, owing: WebhookBacklog) -> None:
        self._owing = owing
        self._written: set[tuple[str, str]] = set()
        self._changes = -1

    def begin(self, kept: Iterable[tuple[str, Alert]], *, leads: bool) -> None:
        """Take what a database has of it. leads: this monitor has raised the alerts all along, and knows better."""
        kept, self._changes = list(kept), -1
        self._written = {(name, alert.id) for name, alert in kept}
        if not leads:
            self._owing.owe(kept)

    def snapshot(self) -> Snapshot | None:
        """Return what is owed now, None if nothing of it has changed.

        It is taken before the alerts that are written, and written after them: an alert is kept before it is owed, and
        upkeep deletes rows of the backlog without their alert.
        """
        changes = self._owing.owed_changes()
        if changes == self._changes:  # most of the time, and there may be thousands
            return None
        return Snapshot(changes, {(name, alert.id): alert for name, alert in self._owing.owed()})

    async def write(self, store: Store, snapshot: Snapshot | None) -> None:
        """Write a snapshot, if there is one, once its alerts are written."""
        if snapshot is None:
            return
        owed = snapshot.owed
        waiting = [(name, alert) for (name, alert_id), alert in owed.items() if (name, alert_id) not in self._written]
        taken = self._written - owed.keys()
        if waiting or taken:
            await store.owe(waiting, taken)
            self._written = set(owed)
        self._changes = snapshot.changes
