"""Rows of a centre's pages: warehouses, their alerts, and the objects of one of their sites. Pure."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from typing import Any, Final
from urllib.parse import quote

from schemas.alerts import Alert, Severity
from schemas.inventory import WarehouseReport
from schemas.world import WorldObject
from services.monitor.formats import natural
from services.monitor.liveness import RobotState
from services.monitor.warehouses.reports import KnownWarehouse
from services.monitor.web.pages.rows.alerts import urgency
from services.monitor.web.pages.rows.formatting import STATE, WHEN, ago, iso, plural, seen_lately
from services.monitor.world.site_status import totals

PATH: Final = "/warehouses"

SORTS: Final[Mapping[str, Callable[[KnownWarehouse], Any]]] = {
    "warehouse": lambda known: natural(known.name),
    "robots": lambda known: (known.report.robots_online, known.report.robots),
    "objects": lambda known: known.objects.total(),
    "alerts": lambda known: sum(known.report.alerts.values()),
}


def address_of_warehouse(name: str) -> str:
    """Return the address of a warehouse's page at its centre."""
    return f"{PATH}/{quote(name, safe='')}"


def sorted_warehouses(
    every: Iterable[KnownWarehouse], sort: str, now_ns: int, *, descending: bool
) -> list[KnownWarehouse]:
    """Return warehouses by a column; by state unless it is one of SORTS: those that do not report first."""
    by = SORTS.get(sort, lambda known: (known.is_current(now_ns), natural(known.name)))
    return sorted(every, key=by, reverse=descending)


def warehouse_row(known: KnownWarehouse, now_ns: int) -> dict[str, Any]:
    """Return a warehouse as a row of the template."""
    of, current = known.report, known.is_current(now_ns)
    return {
        "warehouse": known.name,
        "href": address_of_warehouse(known.name),
        "state": RobotState.ONLINE if current else RobotState.OFFLINE,
        "why": "" if current else f"last report {ago(known.received_ns, now_ns)}",
        "current": current,
        "robots": f"{of.robots_online:,} of {of.robots:,}",
        "cameras": f"{of.cameras_online:,} of {of.cameras:,}",
        "objects": [[f"{count:,}", name] for name, count in sorted(known.objects.items()) if count],
        "alerts": [[severity, of.alerts[severity]] for severity in reversed(Severity) if of.alerts.get(severity)],
        "problems": plural(len(of.problems), "problem") if of.problems else "",
        "heard": ago(known.received_ns, now_ns),
        "heard_at": iso(known.received_ns),
    }


def open_alerts(every: Iterable[KnownWarehouse], most: int) -> list[tuple[str, Alert]]:
    """Return the most urgent open alerts of all warehouses, each with its warehouse."""
    alerts = [(known.name, alert) for known in every for alert in known.report.open]
    return sorted(alerts, key=lambda each: urgency(each[1]))[:most]


def alert_rows(alerts: Sequence[tuple[str, Alert]], now_ns: int) -> str:
    """Return alerts as HTML, a row each; their warehouse is a link."""
    return "".join(
        f'<div class="fs-row" data-alert="{escape(alert.id)}">'
        f'<div><span class="fs-severity fs-{escape(alert.severity)}">{escape(alert.severity)}</span></div>'
        f"<div>{escape(alert.text)}"
        f'<div class="fs-muted fs-small">rule {escape(alert.rule)}, {escape(alert.state)}</div>'
        f'<div class="fs-small"><a class="fs-link" href="{escape(address_of_warehouse(name))}">{escape(name)}</a></div>'
        "</div>"
        f'<div class="fs-far"><time datetime="{iso(alert.raised_ns)}">{ago(alert.raised_ns, now_ns)}</time></div></div>'
        for name, alert in alerts
    )


def facts_of(known: KnownWarehouse, now_ns: int) -> str:
    """Return what is known of a warehouse as HTML, a term and its description each."""
    of = known.report
    facts = [
        ("Last report", ago(known.received_ns, now_ns)),
        ("Its own page", _page(of)),
        ("Version", escape(of.version)),
        ("Robots online", f"{of.robots_online:,} of {of.robots:,}"),
        ("Cameras online", f"{of.cameras_online:,} of {of.cameras:,}"),
        ("Workers", f"{of.workers:,}"),
        ("In view of cameras", escape(totals(of.in_view))),
        ("Problems", "".join(f"<div>{escape(each)}</div>" for each in of.problems) or "none"),
    ]
    return "".join(f"<dt>{term}</dt><dd>{text}</dd>" for term, text in facts)


def _page(of: WarehouseReport) -> str:
    if not of.page.startswith(("https://", "http://")):
        return "not told; its monitor tells it with --web-url"
    return f'<a class="fs-link" href="{escape(of.page)}" rel="noopener">{escape(of.page)}</a>'


def site_rows(of: WarehouseReport, chosen: str) -> str:
    """Return a warehouse's sites as HTML, a row each, with the number of objects by class."""
    return "".join(
        f'<div class="fs-row{"" if site.current else " fs-stale"}" data-site="{escape(site.site)}"><div>'
        f'<a class="fs-link" href="?site={quote(site.site)}"{" aria-current=true" if site.site == chosen else ""}>'
        f"{escape(site.site)}</a></div><div>{escape(totals(site.objects))}"
        f"{'' if site.current else ', as known last'}</div></div>"
        for site in of.sites
    )


def object_rows(objects: Iterable[WorldObject], now_ns: int) -> str:
    """Return objects as HTML, a row each."""
    return "".join(
        f'<div class="fs-row" data-object="{escape(each.id)}"><div><b>{escape(each.name)}</b> '
        f'<span class="fs-muted fs-small">{escape(each.id)}</span></div>'
        f"<div>{each.at[0]:.1f}, {each.at[1]:.1f} m</div>"
        f'<div class="fs-far">{seen_lately(each.last_ns, now_ns)}</div></div>'
        for each in objects
    )


CHIPS: Final = """
<span v-for="each in props.row.objects" class="fs-chip"><b>{{ each[0] }}</b>{{ each[1] }}</span>
<span v-if="!props.row.objects.length" class="fs-muted">nothing yet</span>
"""

URGENT: Final = """
<span v-for="each in props.row.alerts" :class="'fs-severity fs-' + each[0]">{{ each[1] }} {{ each[0] }}</span>
<span v-if="!props.row.alerts.length" class="fs-muted">none</span>
<div class="fs-why" v-if="props.row.problems">{{ props.row.problems }}</div>
"""

LINK: Final = '<a class="fs-link" :href="props.row.href">{{ props.row.warehouse }}</a>'

WAREHOUSE_BODY: Final = f"""
<q-tr :props="props" :class="props.row.current ? '' : 'fs-stale'" :data-warehouse="props.row.warehouse">
  <q-td key="state" :props="props" class="fs-where">{STATE}</q-td>
  <q-td key="warehouse" :props="props" class="fs-name">{LINK}</q-td>
  <q-td key="robots" :props="props">{{{{ props.row.robots }}}}</q-td>
  <q-td key="cameras" :props="props">{{{{ props.row.cameras }}}}</q-td>
  <q-td key="objects" :props="props" class="fs-wide">{CHIPS}</q-td>
  <q-td key="alerts" :props="props" class="fs-wide">{URGENT}</q-td>
  <q-td key="heard" :props="props" {WHEN.format(at="props.row.heard_at")}>{{{{ props.row.heard }}}}</q-td>
</q-tr>
"""

WAREHOUSE_CARD: Final = f"""
<div :class="props.row.current ? 'fs-card' : 'fs-card fs-stale'" :data-warehouse="props.row.warehouse">
  <div class="fs-top"><strong>{LINK}</strong><span>{STATE}</span></div>
  <div class="fs-muted fs-small">{{{{ props.row.robots }}}} robots, {{{{ props.row.cameras }}}} cameras online</div>
  <div>{CHIPS}</div><div>{URGENT}</div>
</div>
"""
