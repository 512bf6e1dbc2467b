"""The state of the fleet as a database holds it, for a monitor that starts. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.alerts import Alert
from services.monitor.history.intervals import Interval
from services.monitor.history.ledger import StoredInterval
from services.monitor.history.operator_actions import Act


@dataclass(frozen=True, slots=True)
class Kept:
    """What a database holds of what goes on: of each class the open interval or the last, and unresolved alerts.

    acts: what was done with these alerts. going_on: the intervals of every kind that are open. owed: the alerts that
    webhooks, by name, did not take yet.
    """

    intervals: Sequence[Interval]
    alerts: Sequence[Alert]
    acts: Sequence[Act]
    going_on: Sequence[StoredInterval]
    owed: Sequence[tuple[str, Alert]] = ()
