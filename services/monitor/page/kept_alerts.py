"""The newest alerts that ended, read from the database once for all who look at them."""

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


@dataclass(frozen=True, slots=True)
class Found:
    """Alerts with what people did with each; problem: why there are none, in words."""

    alerts: Sequence[Alert] = ()
    acts: Mapping[str, Sequence[Act]] = field(default_factory=dict)
    problem: str = ""


class KeptAlerts:
    """The newest alerts that ended."""

    MAX_AGE_S: ClassVar = 3.0

    def __init__(self, archive: Archive) -> None:
        self._archive = archive
        self._ended = Recent(self._read, self.MAX_AGE_S)

    async def ended(self) -> Found:
        """Return the newest alerts that ended."""
        return await self._ended.get()

    async def _read(self) -> Found:
        acts = defaultdict[str, list[Act]](list)
        try:
            alerts = await self._archive.alerts(Asked(), MAX_KEPT, states=[AlertState.RESOLVED])
            for act in await self._archive.acts([alert.id for alert in alerts]) if alerts else ():
                acts[act.alert_id].append(act)
        except HistoryError as error:
            return Found(problem=str(error))
        return Found(alerts, acts)
