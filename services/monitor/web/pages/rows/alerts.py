"""Vue templates of alerts. Pure."""

from collections import Counter
from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import Any, Final

from schemas.alerts import Alert, AlertState, Severity
from services.monitor.formats import natural
from services.monitor.history.state import Act
from services.monitor.inventory.inventory import Inventory
from services.monitor.map.footprints import address_of_id
from services.monitor.snapshot import known_until_ns
from services.monitor.web.pages.rows.formatting import NOTHING, WHEN, ago, iso

URGENCY: Final = {severity: number for number, severity in enumerate(reversed(Severity))}
"""Severities, the most urgent first."""

NEED: Final = {AlertState.ESCALATED: 0, AlertState.RAISED: 1, AlertState.ACKNOWLEDGED: 2, AlertState.RESOLVED: 3}
"""Alert states, the most urgent first."""


class AlertAction(StrEnum):
    """An action on an alert."""

    ACKNOWLEDGE = "acknowledge"
    ESCALATE = "escalate"
    RESOLVE = "resolve"


class Panel(StrEnum):
    """The states of the open alerts' panel. NOT_FOUND: there are alerts, but none matches the search."""

    UNKNOWN = "unknown"
    CALM = "calm"
    NOT_FOUND = "not found"
    ALERTS = "alerts"


ALERT_ACTIONS: Final = {
    AlertState.RAISED: (AlertAction.ACKNOWLEDGE, AlertAction.ESCALATE, AlertAction.RESOLVE),
    AlertState.ACKNOWLEDGED: (AlertAction.ESCALATE, AlertAction.RESOLVE),
    AlertState.ESCALATED: (AlertAction.ACKNOWLEDGE, AlertAction.RESOLVE),
    AlertState.RESOLVED: (),
}


def urgency(alert: Alert) -> tuple[int, int, int]:
    """Return a key by which alerts are sorted: the most severe first, then unacknowledged ones, then the newest."""
    return URGENCY[alert.severity], NEED[alert.state], -alert.raised_ns


def most_urgent_first(alerts: Iterable[Alert]) -> list[Alert]:
    """Return alerts by severity, then unacknowledged ones, then the newest."""
    return sorted(alerts, key=urgency)


def wanted_alerts(alerts: Iterable[Alert], severity: Severity | None, text: str) -> list[Alert]:
    """Return the alerts of a severity, or of any, that contain `text` anywhere."""
    text = text.strip().casefold()
    return [each for each in alerts if severity in (None, each.severity) and (not text or _says(each, text))]


def sorted_alerts(alerts: Sequence[Alert], sort: str, *, descending: bool) -> list[Alert]:
    """Return alerts by severity, robot, state or the time they were raised or ended."""
    match sort:
        case "robot":
            found = sorted(alerts, key=lambda each: (natural(each.robot), natural(each.camera)))
        case "state":
            found = sorted(alerts, key=lambda each: NEED[each.state])
        case "raised":
            found = sorted(alerts, key=lambda each: -each.raised_ns)
        case "ended":
            found = sorted(alerts, key=lambda each: -each.changed_ns)
        case _:
            found = most_urgent_first(alerts)
    return found[::-1] if descending else found


def panel_of(every: Sequence[Alert] | None, found: Sequence[Alert]) -> Panel:
    """Return the panel's state. every: all open alerts; None if unknown. found: those that match the search."""
    if every is None:
        return Panel.UNKNOWN
    if not every:
        return Panel.CALM
    return Panel.ALERTS if found else Panel.NOT_FOUND


def severity_figures(every: Sequence[Alert] | None) -> dict[Severity, str]:
    """Return the number of open alerts of each severity; every: None if unknown."""
    counts = Counter(alert.severity for alert in every or ())
    return {severity: NOTHING if every is None else f"{counts[severity]:,}" for severity in Severity}


def unattended_figure(every: Sequence[Alert] | None) -> tuple[str, str]:
    """Return the figures of unacknowledged alerts and of open alerts; every: None if unknown."""
    if every is None:
        return NOTHING, ""
    return f"{sum(alert.state is not AlertState.ACKNOWLEDGED for alert in every):,}", f"of {len(every):,}"


def doubt_of(alert: Alert, inventory: Inventory, now_ns: int) -> str:
    """Return why an alert's condition is unconfirmed, and since when; empty if it is current."""
    until_ns = known_until_ns(alert, inventory, now_ns)
    if until_ns is None:
        return ""
    gone = f"{alert.camera} is silent" if inventory.is_alive(alert.robot) else f"{alert.robot} is offline"
    return f"not known now: {gone}, last seen {ago(until_ns, now_ns)}"


def raised_by(leader: str) -> str:
    """Return which other monitor raises the alerts, as far as that is known."""
    named = f"Another monitor ({leader})" if leader else "Another monitor"
    return f"{named} raises the alerts. Those below are from the shared history; act on them there."


def alert_row(alert: Alert, acts: Sequence[Act], now_ns: int, *, may_act: bool, doubt: str = "") -> dict[str, Any]:
    """Return an alert as row of its templates. may_act: the visitor may act on it. doubt: see `doubt_of`."""
    return {
        "id": alert.id,
        "severity": alert.severity,
        "text": alert.text,
        "doubt": doubt,
        "rule": alert.rule,
        "robot": alert.robot,
        "camera": alert.camera,
        "object": alert.object,
        "href": address_of_id(alert.site, alert.object) if alert.object else "",
        "state": alert.state,
        "raised": ago(alert.raised_ns, now_ns),
        "raised_at": iso(alert.raised_ns),
        "ended": ago(alert.changed_ns, now_ns) if alert.state is AlertState.RESOLVED else "",
        "ended_at": iso(alert.changed_ns),
        "acts": [f"{act.state} by {act.who}, {ago(act.at_ns, now_ns)}" for act in acts],
        "actions": [str(action) for action in ALERT_ACTIONS[alert.state]] if may_act else [],
    }


def _says(alert: Alert, text: str) -> bool:
    return any(
        text in each.casefold()
        for each in (alert.text, alert.rule, alert.robot, alert.camera, alert.name, alert.object)
    )


SEVERITY: Final = """<span :class="'fs-severity fs-' + props.row.severity">{{ props.row.severity }}</span>"""

WHERE: Final = """
<a v-if="props.row.camera" class="fs-link"
  :href="'/cameras/' + encodeURIComponent(props.row.robot) + '/' + encodeURIComponent(props.row.camera)"
  ><b>{{ props.row.robot }}</b>/{{ props.row.camera }}</a><b v-else>{{ props.row.robot }}</b>
<a v-if="props.row.object" class="fs-link" :href="props.row.href">{{ props.row.object }}</a>
"""

ACTION_BUTTONS: Final = """
<q-btn v-for="action in props.row.actions" :key="action" flat dense no-caps color="primary" class="q-px-sm"
  :label="action" :aria-label="action + ' ' + props.row.text"
  @click="$parent.$emit('action', [action, props.row.id])" />
"""

SAID: Final = """
<div>{{ props.row.text }}</div>
<div v-if="props.row.doubt">{{ props.row.doubt }}</div>
<div class="fs-why">{{ props.row.rule }}</div>
<div class="fs-why" v-for="act in props.row.acts">{{ act }}</div>
"""

OPEN_BODY: Final = f"""
<q-tr :props="props" :class="props.row.doubt ? 'fs-stale' : ''" :data-alert="props.row.id">
  <q-td key="severity" :props="props">{SEVERITY}</q-td>
  <q-td key="text" :props="props" class="fs-wide">{SAID}</q-td>
  <q-td key="robot" :props="props" class="fs-where">{WHERE}</q-td>
  <q-td key="state" :props="props">{{{{ props.row.state }}}}</q-td>
  <q-td key="raised" :props="props" {WHEN.format(at="props.row.raised_at")}>{{{{ props.row.raised }}}}</q-td>
  <q-td key="actions" :props="props" class="fs-actions">{ACTION_BUTTONS}</q-td>
</q-tr>
"""

ENDED_BODY: Final = f"""
<q-tr :props="props" :data-alert="props.row.id">
  <q-td key="severity" :props="props">{SEVERITY}</q-td>
  <q-td key="text" :props="props" class="fs-wide">{SAID}</q-td>
  <q-td key="robot" :props="props" class="fs-where">{WHERE}</q-td>
  <q-td key="raised" :props="props" {WHEN.format(at="props.row.raised_at")}>{{{{ props.row.raised }}}}</q-td>
  <q-td key="ended" :props="props" {WHEN.format(at="props.row.ended_at")}>{{{{ props.row.ended }}}}</q-td>
</q-tr>
"""

CARD: Final = f"""
<div :class="props.row.doubt ? 'fs-card fs-stale' : 'fs-card'" :data-alert="props.row.id">
  <div class="fs-top"><span>{SEVERITY} <span class="fs-muted fs-small">{{{{ props.row.state }}}}</span></span>
    <span class="fs-muted fs-small">{{{{ props.row.ended || props.row.raised }}}}</span></div>
  <div>{SAID}</div>
  <div class="fs-top"><span>{WHERE}</span></div>
  <div v-if="props.row.actions.length" class="fs-actions">{ACTION_BUTTONS}</div>
</div>
"""
