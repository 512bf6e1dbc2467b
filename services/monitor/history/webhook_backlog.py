"""Persists alerts that webhooks have not accepted yet, so that a restart loses none."""

from collections.abc import Iterable, Iterator
from typing import Protocol

from schemas.alerts import Alert
from services.monitor.history.store import Store


class Owing(Protocol):
    """Posts alerts to webhooks, each by its name in the rule file."""

    def owe(self, alerts: Iterable[tuple[str, Alert]]) -> None:
        """Take the alerts that were not accepted before a restart."""

    def owed(self) -> Iterator[tuple[str, Alert]]:
        """Yield the alerts that have not been accepted yet."""


class Nothing:
    """An empty backlog."""

    def owe(self, alerts: Iterable[tuple[str, Alert]]) -> None:
        """Ignore the alerts."""

    def owed(self) -> Iterator[tuple[str, Alert]]:
        """Yield nothing."""
        return iter(())


class Owed:
    """Writes changes of the backlog."""

    def __init__(self, owing: Owing) -> None:
        self._owing = owing
        self._written: set[tuple[str, str]] = set()

    def begin(self, kept: Iterable[tuple[str, Alert]], *, leads: bool) -> None:
        """Load the backlog of a database. leads: this monitor has raised the alerts all along, so its own is newer."""
        kept = list(kept)
        self._written = {(name, alert.id) for name, alert in kept}
        if not leads:
            self._owing.owe(kept)

    async def write(self, store: Store) -> None:
        """Write the backlog, after the alerts themselves."""
        owed = {(name, alert.id): alert for name, alert in self._owing.owed()}
        waiting = [(name, alert) for (name, alert_id), alert in owed.items() if (name, alert_id) not in self._written]
        taken = self._written - owed.keys()
        if waiting or taken:
            await store.owe(waiting, taken)
            self._written = set(owed)
