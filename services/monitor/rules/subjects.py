"""Alerts of rules: what each rule is about in one place, and what changed of it. Pure."""

from dataclasses import dataclass
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

from schemas.alerts import Alert
from services.monitor.inventory.sighting import NS
from services.monitor.rules.model import AnyRule


class UnknownAlertError(Exception):
    """No such alert, or it is resolved already."""


@dataclass(frozen=True, slots=True)
class Effect:
    """An alert changed. rule: the one that raised it; None if it is gone. raised: it is new, so act.

    escalated: it escalates, or had escalated before.
    """

    alert: Alert
    rule: AnyRule | None
    raised: bool
    escalated: bool = False


@dataclass(slots=True, eq=False)
class Subject:
    """What one rule is about in one place. known: it is known whether it holds, or held at least when it was last."""

    holds: bool = False
    known: bool = True
    since_ns: int = 0
    text: str = ""
    raised_ns: int | None = None
    alert: Alert | None = None


def local_time(now_ns: int, timezone: str | None) -> datetime:
    utc = datetime.fromtimestamp(now_ns / NS, UTC)
    return utc.astimezone(ZoneInfo(timezone) if timezone else None)
