"""Reads from the monitor's history what came of the class lists and alerts."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from sqlalchemy import func, select

from benchmarks.chaos.accounts import PALLET, Published
from schemas.alerts import AlertState
from services.monitor.history.engine import engine_of, translating
from services.monitor.history.tables import alerts, intervals

AT_ONCE: Final = 500


class Store:
    """The history of a monitor, by its URL. It is read as any other program might read it."""

    def __init__(self, url: str) -> None:
        self._engine = engine_of(url)

    async def rows(self, marks: Sequence[str]) -> Counter[str]:
        """Return how many intervals each class list made.

        Raises:
            HistoryError: the database does not answer.
        """
        found = Counter[str]()
        for first in range(0, len(marks), AT_ONCE):
            wanted = select(intervals.c.name, func.count()).where(
                intervals.c.robot == "r1", intervals.c.name.in_(marks[first : first + AT_ONCE])
            )
            async with translating(), self._engine.connect() as connection:
                rows = (await connection.execute(wanted.group_by(intervals.c.name))).all()
            for name, number in rows:
                found[name] += number
        return found

    async def alerts(self) -> Mapping[str, bool]:
        """Return the ids of all alerts about pallets, and whether each is open.

        Raises:
            HistoryError: the database does not answer.
        """
        wanted = select(alerts.c.id, alerts.c.state).where(alerts.c.name == PALLET)
        async with translating(), self._engine.connect() as connection:
            rows = (await connection.execute(wanted)).all()
        return {row.id: row.state != AlertState.RESOLVED for row in rows}


class Journal:
    """What workers published, in order."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._read = 0
        self._lists: list[Published] = []

    def lists(self) -> Sequence[Published]:
        """Return all lists so far."""
        if self._file.exists():
            with self._file.open(encoding="ascii") as file:
                file.seek(self._read)
                while (line := file.readline()).endswith("\n"):
                    self._lists.append(Published.read(line))
                    self._read = file.tell()
        return self._lists
