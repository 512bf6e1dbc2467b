"""Subjects of rules: one rule at one place each, with its condition and alert. Pure."""

from dataclasses import dataclass
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

from schemas.alerts import Alert
from services.monitor.inventory.sighting import NS
from services.monitor.rules.model import AnyRule


class UnknownAlertError(Exception):
    """The alert does not exist, or is resolved already."""


@dataclass(frozen=True, slots=True)
class Effect:
    """A changed alert. rule: the one that raised it; None if it was removed. raised: it is new, so send the action.

    escalated: it escalates, or had escalated before.
    """

    alert: Alert
    rule: AnyRule | None
    raised: bool
    escalated: bool = False


@dataclass(slots=True, eq=False)
class Subject:
    """One rule at one place. known: whether the condition holds is known, at least as of its last observation."""

    holds: bool = False
    known: bool = True
    since_ns: int = 0
    text: str = ""
    raised_ns: int | None = None
    alert: Alert | None = None


def local_time(now_ns: int, timezone: str | None) -> datetime:
    utc = datetime.fromtimestamp(now_ns / NS, UTC)
    return utc.astimezone(ZoneInfo(timezone) if timezone else None)
