"""The alerts page: open alerts, actions on them, and resolved ones."""

import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar, Final

from nicegui import events, ui

from schemas.alerts import Alert, AlertState, Severity
from services.monitor.event_loop.cached_value import CachedValue
from services.monitor.history.archive import Archive, HistoryQuery
from services.monitor.history.state import Act, HistoryError
from services.monitor.monitor import Monitor
from services.monitor.rules.subjects import UnknownAlertError
from services.monitor.web.auth.users import Visitor
from services.monitor.web.pages.components import ALERTS, Confirmation, Tile
from services.monitor.web.pages.frame import REFRESH_S, banner, export_link, nothing_yet, page_at, page_frame
from services.monitor.web.pages.live_table import SEARCH, Choices, Column, LiveTable, Loaded, RowWindow, search_field
from services.monitor.web.pages.rows.alerts import (
    CARD,
    ENDED_BODY,
    OPEN_BODY,
    AlertAction,
    Panel,
    alert_row,
    doubt_of,
    panel_of,
    raised_by,
    severity_figures,
    sorted_alerts,
    unattended_figure,
    wanted_alerts,
)
from services.monitor.web.pages.rows.formatting import plural

MAX_KEPT: Final = 200


@dataclass(frozen=True, slots=True)
class AlertList:
    """Alerts with operators' actions; problem: why there are none, in words."""

    alerts: Sequence[Alert] = ()
    acts: Mapping[str, Sequence[Act]] = field(default_factory=dict)
    problem: str = ""


class KeptAlerts:
    """The newest resolved alerts."""

    MAX_AGE_S: ClassVar = 3.0

    def __init__(self, archive: Archive) -> None:
        self._archive = archive
        self._ended = CachedValue(self._read, self.MAX_AGE_S)

    async def ended(self) -> AlertList:
        """Return the newest resolved alerts."""
        return await self._ended.get()

    async def _read(self) -> AlertList:
        acts = defaultdict[str, list[Act]](list)
        try:
            alerts = await self._archive.alerts(HistoryQuery(), MAX_KEPT, states=[AlertState.RESOLVED])
            for act in await self._archive.acts([alert.id for alert in alerts]) if alerts else ():
                acts[act.alert_id].append(act)
        except HistoryError as error:
            return AlertList(problem=str(error))
        return AlertList(alerts, acts)


OPEN_COLUMNS: Final = (
    Column("severity", "Severity"),
    Column("text", "What", sortable=False),
    Column("robot", "Where"),
    Column("state", "State"),
    Column("raised", "Raised", align="right"),
    Column("actions", "Actions", sortable=False, align="right"),
)

ENDED_COLUMNS: Final = (
    Column("severity", "Severity"),
    Column("text", "What", sortable=False),
    Column("robot", "Where"),
    Column("raised", "Raised", align="right"),
    Column("ended", "Resolved", align="right"),
)


def add_alerts(monitor: Monitor, kept: KeptAlerts) -> None:
    """Add the page."""

    @page_at(ALERTS.path)
    async def alerts() -> None:
        async with page_frame(monitor, "Alerts", ALERTS) as visitor:
            _Alerts(monitor, kept, visitor)


class _Alerts:
    """One browser's view of the alerts."""

    def __init__(self, monitor: Monitor, kept: KeptAlerts, visitor: Visitor) -> None:
        self._monitor = monitor
        self._kept = kept
        self._visitor = visitor
        self._choices = Choices()
        self._severity = next((each for each in Severity if each == self._choices["severity"]), None)
        self._text = self._choices[SEARCH]
        self._elsewhere = ui.element("div")
        with self._elsewhere:
            self._elsewhere_text = banner("")
        with ui.element("div").classes("fs-tiles"):
            self._tiles = {
                severity: Tile(severity.capitalize(), on_click=partial(self._only, severity))
                for severity in reversed(Severity)
            }
            self._unseen = Tile("Not acknowledged")
        self._open_panel()
        self._ended_panel()
        self._sure = Confirmation(
            "Resolve", "Keep it open", "This cannot be undone. It is raised again only after its condition has cleared."
        )
        for part in (self._elsewhere, self._unknown, self._calm, self._none):
            part.set_visibility(False)
        ui.timer(REFRESH_S, self.refresh)  # a slow database does not delay the page
        ui.timer(KeptAlerts.MAX_AGE_S, self.look_back)

    def _open_panel(self) -> None:
        with ui.element("div").classes("fs-panel"):
            with ui.element("div").classes("fs-panel-head"):
                with ui.element("h2"):
                    ui.label("Open")
                search_field("Robot, rule or text", self._look_for, self._text)
                self._found = ui.label().classes("fs-muted")
            self._open = LiveTable(
                OPEN_COLUMNS, self._load_open, row_key="id", sort="severity", body=OPEN_BODY, card=CARD
            )
            self._open.table.on("action", self._do)
            self._unknown = ui.element("div")
            with self._unknown:
                nothing_yet(
                    "help",
                    "Open alerts are unknown",
                    "Another monitor raises them, and its history cannot be read:",
                )
                self._why_unknown = ui.label().classes("fs-empty")
            self._calm = nothing_yet("check_circle", "No open alerts", *_what_raises(self._monitor))
            self._none = nothing_yet("search_off", "No alert matches", "Clear the search, or choose another severity.")

    def _ended_panel(self) -> None:
        with ui.element("div").classes("fs-panel"):
            with ui.element("div").classes("fs-panel-head"):
                with ui.element("h2"):
                    ui.label("Resolved")
                ui.label(f"the newest {MAX_KEPT}").classes("fs-muted fs-small")
                ui.element("div").classes("fs-spring")
                export_link(self._monitor, "alerts")
            self._ended = LiveTable(
                ENDED_COLUMNS, self._load_ended, row_key="id", sort="ended", body=ENDED_BODY, card=CARD
            )
            self._no_history = ui.label().classes("fs-empty")

    async def refresh(self) -> None:
        """Show the alerts as they are now."""
        await self._open.refresh()

    async def look_back(self) -> None:
        """Show the resolved alerts."""
        await self._ended.refresh()

    async def _load_open(self, window: RowWindow) -> Loaded:
        leads = self._monitor.history.status.leads
        self._elsewhere.set_visibility(not leads)  # before waiting for a database, which may be slow
        self._elsewhere_text.set_text(raised_by(self._monitor.history.status.leader))
        every: Sequence[Alert] | None = None
        why_unknown = ""
        try:
            every = await self._monitor.current_alerts()
        except HistoryError as error:
            why_unknown = str(error)
        found = wanted_alerts(every or (), self._severity, self._text)
        shown = sorted_alerts(found, window.sort, descending=window.descending)[window.begin : window.end]
        may_act = leads and self._visitor.may_act
        rows = [self._row(each, may_act=may_act) for each in shown]
        return Loaded(rows, len(found), partial(self._count, every, found, why_unknown))

    def _row(self, alert: Alert, *, may_act: bool) -> dict[str, Any]:
        now_ns = time.time_ns()
        doubt = doubt_of(alert, self._monitor.fleet.inventory, now_ns)
        return alert_row(alert, self._monitor.acts_of(alert.id), now_ns, may_act=may_act, doubt=doubt)

    async def _load_ended(self, window: RowWindow) -> Loaded:
        ended = await self._kept.ended()
        now_ns = time.time_ns()
        shown = sorted_alerts(ended.alerts, window.sort, descending=window.descending)[window.begin : window.end]
        rows = [alert_row(each, ended.acts.get(each.id, ()), now_ns, may_act=False) for each in shown]
        return Loaded(rows, len(ended.alerts), partial(self._count_ended, ended))

    def _count_ended(self, ended: AlertList) -> None:
        self._no_history.set_text(ended.problem or "No alert has been resolved yet.")
        self._no_history.set_visibility(not ended.alerts)

    def _count(self, every: Sequence[Alert] | None, found: Sequence[Alert], why_unknown: str) -> None:
        for severity, figure in severity_figures(every).items():
            self._tiles[severity].show(figure, on=severity is self._severity)
        there = {alert.severity for alert in every or ()}
        self._tiles[Severity.CRITICAL].color("fs-bad" if Severity.CRITICAL in there else "")
        self._tiles[Severity.WARNING].color("fs-warn" if Severity.WARNING in there else "")
        self._unseen.show(*unattended_figure(every))
        count = len(every or ())
        self._found.set_text(f"{len(found):,} of {count:,}" if len(found) != count else "")
        panel = panel_of(every, found)
        self._why_unknown.set_text(why_unknown)
        self._unknown.set_visibility(panel is Panel.UNKNOWN)
        self._calm.set_visibility(panel is Panel.CALM)
        self._none.set_visibility(panel is Panel.NOT_FOUND)

    async def _only(self, severity: Severity) -> None:
        self._severity = None if self._severity is severity else severity
        self._choices.keep("severity", self._severity or "")
        await self._open.begin()

    async def _look_for(self, text: str) -> None:
        self._text = text
        self._choices.keep(SEARCH, text)
        await self._open.begin()

    async def _do(self, event: events.GenericEventArguments) -> None:
        action, alert_id = AlertAction(event.args[0]), str(event.args[1])
        if not self._visitor.may_act:
            ui.notify("Only operators may do that.", type="warning")
            return
        do = {
            AlertAction.ACKNOWLEDGE: self._monitor.acknowledge,
            AlertAction.ESCALATE: self._monitor.escalate,
            AlertAction.RESOLVE: self._monitor.resolve,
        }[action]
        try:
            if action is AlertAction.RESOLVE and not await self._means_it(alert_id):
                return
            do(alert_id, by=self._visitor.name)
        except UnknownAlertError:
            ui.notify("This alert is no longer open.", type="info")
        await self.refresh()

    async def _means_it(self, alert_id: str) -> bool:
        alert = next((each for each in self._monitor.alerts() if each.id == alert_id), None)
        if alert is None:
            raise UnknownAlertError(alert_id)
        return await self._sure.given(f"Resolve: {alert.text}?")


def _what_raises(monitor: Monitor) -> Sequence[str]:
    rules = len(monitor.rules.book.rules)
    if rules:
        return (f"{plural(rules, 'rule')} in force.",)
    return (
        "No rules are in force, so no alerts are raised.",
        "Write some and start the monitor with --rules rules.yaml.",
    )
