"""Times at which alerts were raised and escalated, by a clock that may have been set back. Pure."""

from msgspec.structs import replace

from schemas.alerts import Alert, AlertState
from services.monitor.inventory.sighting import NS
from services.monitor.rules.model import AnyRule


def had_escalated(alert: Alert, rule: AnyRule | None) -> bool:
    """Whether an alert has escalated, or was acknowledged only after its escalation time."""
    if rule is None or rule.escalate_after_s is None:
        return alert.state is AlertState.ESCALATED
    due_ns = alert.raised_ns + round(rule.escalate_after_s * NS)
    return alert.state is AlertState.ESCALATED or alert.changed_ns >= due_ns


def set_back(alert: Alert, now_ns: int, by_ns: int) -> Alert:
    """Return the alert, raised no later than now."""
    if alert.raised_ns <= now_ns:
        return alert
    return replace(alert, raised_ns=alert.raised_ns - by_ns, changed_ns=alert.changed_ns - by_ns)
