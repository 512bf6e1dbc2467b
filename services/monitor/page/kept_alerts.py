"""Alerts of the database, read once for all who look at them."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final

from schemas.alerts import Alert, AlertState
from services.monitor.history.acts import Act
from services.monitor.history.archive import Archive, Asked
from services.monitor.history.errors import HistoryError
from services.monitor.recent import Recent

MAX_KEPT: Final = 200
MAX_OPEN: Final = 1_000


@dataclass(frozen=True, slots=True)
class Found:
    """Alerts with what people did with each; problem: why there are none, in words."""

    alerts: Sequence[Alert] = ()
    acts: Mapping[str, Sequence[Act]] = field(default_factory=dict)
    problem: str = ""


class KeptAlerts:
    """The newest alerts that ended, and those that another monitor has open."""

    MAX_AGE_S: ClassVar = 3.0

    def __init__(self, archive: Archive) -> None:
        self._archive = archive
        self._ended = Recent(lambda: self._read([AlertState.RESOLVED], MAX_KEPT), self.MAX_AGE_S)
        open_states = [state for state in AlertState if state is not AlertState.RESOLVED]
        self._open = Recent(lambda: self._read(open_states, MAX_OPEN), self.MAX_AGE_S)

    async def ended(self) -> Found:
        """Return the newest alerts that ended."""
        return await self._ended.get()

    async def open(self) -> Found:
        """Return the alerts that are open."""
        return await self._open.get()

    async def _read(self, states: Sequence[AlertState], limit: int) -> Found:
        acts = defaultdict[str, list[Act]](list)
        try:
            alerts = await self._archive.alerts(Asked(), limit, states=states)
            for act in await self._archive.acts([alert.id for alert in alerts]) if alerts else ():
                acts[act.alert_id].append(act)
        except HistoryError as error:
            return Found(problem=str(error))
        return Found(alerts, acts)
