"""The history's errors and status, the stored state that a monitor starts with, operators' actions. Pure."""

from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Final

from msgspec.structs import replace

from schemas.alerts import Alert, AlertState
from services.monitor.history.interval_buffer import StoredInterval
from services.monitor.history.intervals import Interval


class HistoryError(Exception):
    """The database cannot be opened, read or written; the message names the cause."""


class OtherVersionError(HistoryError):
    """The database's tables are those of another version."""


@dataclass(frozen=True, slots=True)
class HistoryStatus:
    """The status of the history.

    problem: why it is not being kept, in words, or empty. leads: this monitor is the one that raises alerts; while the
    database is unreachable, that stays as it was; a monitor that never reached it raises them.
    pending: what waits to be written, none while another one leads. lost: intervals given up because too many waited.
    leader: who else leads, as host and process, as far as that is known. warnings: why old history is not forgotten.
    """

    problem: str
    leads: bool
    pending: int
    lost: int
    leader: str = ""
    warnings: Sequence[str] = ()


MAX_ALERTS: Final = 10_000
"""Maximum number of alerts whose actions are remembered; the database keeps all."""

MAX_ACTS: Final = 100
"""Maximum number of actions remembered per alert, the newest ones."""


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


class PendingAlerts:
    """Alerts in their current state, and actions on them, that are not written yet; the oldest give way to newer ones.

    Its length is the number of alerts.
    """

    def __init__(self) -> None:
        self._alerts: dict[str, Alert] = {}
        self._acts: deque[Act] = deque(maxlen=MAX_ALERTS)

    def __len__(self) -> int:
        return len(self._alerts)

    def put(self, alert: Alert) -> None:
        """Take a changed alert."""
        self._alerts[alert.id] = alert
        while len(self._alerts) > MAX_ALERTS:
            del self._alerts[next(iter(self._alerts))]

    def put_act(self, act: Act) -> None:
        """Take an action."""
        self._acts.append(act)

    def snapshot(self) -> tuple[dict[str, Alert], set[Act]]:
        """Return all of it, the alerts by their ids."""
        return dict(self._alerts), set(self._acts)

    def written(self, alerts: Mapping[str, Alert], acts: AbstractSet[Act]) -> None:
        """Remove what was written, unless it changed meanwhile."""
        self._alerts = {name: alert for name, alert in self._alerts.items() if alerts.get(name) is not alert}
        self._acts = deque((act for act in self._acts if act not in acts), maxlen=MAX_ALERTS)

    def correct(self, corrected: Callable[[int], int]) -> None:
        """Correct all times."""
        self._alerts = {name: at_other_times(alert, corrected) for name, alert in self._alerts.items()}
        self._acts = deque((act.at_other_time(corrected) for act in self._acts), maxlen=MAX_ALERTS)


@dataclass(frozen=True, slots=True)
class StoredState:
    """The stored state: of each class the open interval or the last one, and unresolved alerts.

    acts: what was done with these alerts. going_on: the intervals of every kind that are open. owed: the alerts that
    webhooks, by name, did not take yet.
    """

    intervals: Sequence[Interval]
    alerts: Sequence[Alert]
    acts: Sequence[Act]
    going_on: Sequence[StoredInterval]
    owed: Sequence[tuple[str, Alert]] = ()
