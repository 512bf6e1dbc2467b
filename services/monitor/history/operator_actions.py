"""Operators' actions on alerts: who, what and when. Pure."""

from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

from msgspec.structs import replace

from schemas.alerts import Alert, AlertState

MAX_ALERTS: Final = 10_000
"""Of how many alerts it is remembered here; the database keeps all."""

MAX_ACTS: Final = 100
"""What is remembered of one alert, the newest."""


@dataclass(frozen=True, slots=True)
class Act:
    """One operator's action on an alert. state: the resulting state. who: a user's name. at_ns: epoch, ours."""

    alert_id: str
    state: AlertState
    who: str
    at_ns: int

    def at_other_time(self, corrected: Callable[[int], int]) -> "Act":
        """Return it with its time corrected."""
        return Act(self.alert_id, self.state, self.who, corrected(self.at_ns))


class Acts:
    """The actions on each alert, in order."""

    def __init__(self) -> None:
        self._acts: OrderedDict[str, tuple[Act, ...]] = OrderedDict()

    def take(self, acts: Iterable[Act]) -> None:
        """Remember actions; at the limit those of the least recently changed alerts are forgotten."""
        for act in acts:
            known = self._acts.get(act.alert_id, ())
            if act not in known:
                self._acts[act.alert_id] = (*known, act)[-MAX_ACTS:]
                self._acts.move_to_end(act.alert_id)
        while len(self._acts) > MAX_ALERTS:
            self._acts.popitem(last=False)

    def correct(self, corrected: Callable[[int], int]) -> None:
        """Correct the times of all."""
        for name, acts in self._acts.items():
            self._acts[name] = tuple(act.at_other_time(corrected) for act in acts)

    def of(self, alert_id: str) -> tuple[Act, ...]:
        """Return the actions on an alert."""
        return self._acts.get(alert_id, ())


def resolved(alert: Alert, now_ns: int) -> Alert:
    """Return an alert in its resolved state."""
    if alert.state is AlertState.RESOLVED:
        return alert
    return replace(alert, state=AlertState.RESOLVED, changed_ns=max(now_ns, alert.changed_ns + 1))


def at_other_times(alert: Alert, corrected: Callable[[int], int]) -> Alert:
    """Return an alert with its times corrected."""
    return replace(alert, raised_ns=corrected(alert.raised_ns), changed_ns=corrected(alert.changed_ns))
