"""A centre's pages: all warehouses that report to it, and one of them."""

import time
from functools import partial
from typing import Final

from nicegui import ui

from bus import RequestError
from schemas.alerts import Severity
from schemas.errors import SchemaError
from services.monitor.monitor import Monitor
from services.monitor.warehouses.reports import KnownWarehouse
from services.monitor.warehouses.requests import WarehouseObjects
from services.monitor.web.pages.components import WAREHOUSES, Tile, panel, still
from services.monitor.web.pages.frame import REFRESH_S, nothing_yet, page_at, page_frame
from services.monitor.web.pages.live_table import Choices, Column, LiveTable, Loaded, RowWindow
from services.monitor.web.pages.picture_frame import VIEW_STYLE
from services.monitor.web.pages.rows.formatting import plural
from services.monitor.web.pages.rows.warehouses import (
    PATH,
    WAREHOUSE_BODY,
    WAREHOUSE_CARD,
    alert_rows,
    facts_of,
    object_rows,
    open_alerts,
    site_rows,
    sorted_warehouses,
    warehouse_row,
)

MOST_ALERTS: Final = 50
MOST_OBJECTS: Final = 200
OBJECTS_S: Final = 5.0
MOST_CHARACTERS: Final = 64

COLUMNS: Final = (
    Column("state", "State"),
    Column("warehouse", "Warehouse"),
    Column("robots", "Robots online", align="right"),
    Column("cameras", "Cameras online", align="right", sortable=False),
    Column("objects", "Objects"),
    Column("alerts", "Open alerts"),
    Column("heard", "Last report", align="right", sortable=False),
)


def add_warehouses(monitor: Monitor) -> None:
    """Add the pages."""
    asked = WarehouseObjects(monitor.bus)

    @page_at(PATH)
    async def warehouses() -> None:
        async with page_frame(monitor, "Warehouses", WAREHOUSES):
            ui.add_css(VIEW_STYLE)
            await _Warehouses(monitor).refresh()

    @page_at(f"{PATH}/{{name}}")
    async def warehouse(name: str) -> None:
        name = name[:MOST_CHARACTERS]
        async with page_frame(monitor, f"Warehouse {name}", WAREHOUSES):
            ui.add_css(VIEW_STYLE)
            _Warehouse(monitor, asked, name).refresh()


class _Warehouses:
    """One browser's view of all warehouses."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._known = monitor.fleet.warehouses
        with ui.element("div").classes("fs-tiles"):
            self._reporting, self._robots = Tile("Warehouses"), Tile("Robots online")
            self._critical, self._alerts = Tile("Critical alerts"), Tile("Open alerts")
        with ui.element("div").classes("fs-panel"):
            self._table = LiveTable(
                COLUMNS, self._load, row_key="warehouse", sort="state", body=WAREHOUSE_BODY, card=WAREHOUSE_CARD
            )
            self._none = nothing_yet(
                "warehouse",
                "No warehouse reports here",
                "A warehouse's own monitor reports its totals, alerts and objects to a centre. Start it with:",
                command="fleetsight monitor --warehouse NAME --centre tls/THIS-MONITOR:7447",
            )
        with ui.element("div").classes("fs-panel") as self._alerts_panel:
            with ui.element("div").classes("fs-panel-head"), ui.element("h2"):
                ui.label("Open alerts")
            self._list = still("").classes("fs-scroll").props('tabindex=0 role=region aria-label="Open alerts"')
            self._more = ui.label().classes("fs-line fs-muted")
        ui.timer(REFRESH_S, self.refresh, immediate=False)

    async def refresh(self) -> None:
        """Show the current state."""
        await self._table.refresh()

    async def _load(self, window: RowWindow) -> Loaded:
        now_ns, every = time.time_ns(), self._known.every()
        found = sorted_warehouses(every, window.sort, now_ns, descending=window.descending)
        rows = [warehouse_row(each, now_ns) for each in found[window.begin : window.end]]
        return Loaded(rows, len(found), partial(self._show, every, now_ns))

    def _show(self, every: list[KnownWarehouse], now_ns: int) -> None:
        current = [each for each in every if each.is_current(now_ns)]
        self._reporting.show(f"{len(current):,}", f"of {len(every):,}")
        self._reporting.color("fs-bad" if len(current) < len(every) else "")
        robots = sum(each.report.robots for each in current)
        self._robots.show(f"{sum(each.report.robots_online for each in current):,}", f"of {robots:,}")
        critical = sum(each.report.alerts.get(Severity.CRITICAL, 0) for each in current)
        count = sum(sum(each.report.alerts.values()) for each in current)
        self._critical.show(f"{critical:,}")
        self._critical.color("fs-bad" if critical else "")
        self._alerts.show(f"{count:,}")
        shown = open_alerts(current, MOST_ALERTS)
        self._list.set_content(alert_rows(shown, now_ns))
        more = count - len(shown)
        self._more.set_text(f"and {plural(more, 'more', 'more')}" if more > 0 else "" if shown else "None.")
        self._none.set_visibility(not every)
        self._alerts_panel.set_visibility(bool(every))


class _Warehouse:
    """One browser's view of one warehouse."""

    def __init__(self, monitor: Monitor, asked: WarehouseObjects, name: str) -> None:
        self._monitor, self._asked, self._name = monitor, asked, name
        self._site = Choices()["site"]
        with ui.element("div").classes("fs-stack") as self._there:
            self._notice = ui.label().classes("fs-line fs-notice").props('role="status"')
            with panel(name):
                self._facts = still("", tag="dl").classes("fs-facts")
            with panel("Objects by site"):
                self._sites = still("")
                self._no_site = ui.label("No world model looks after a site there.").classes("fs-line fs-muted")
            with panel("Objects") as self._objects_panel:
                self._objects = still("").classes("fs-scroll").props('tabindex=0 role=region aria-label="Objects"')
                self._about = ui.label().classes("fs-line fs-muted")
            with panel("Open alerts"):
                self._alerts = still("").classes("fs-scroll").props('tabindex=0 role=region aria-label="Open alerts"')
                self._no_alert = ui.label("None.").classes("fs-line fs-muted")
        self._none = nothing_yet(
            "search_off",
            "There is no such warehouse",
            f"{name} has not reported since this monitor began.",
        )
        ui.timer(REFRESH_S, self.refresh, immediate=False)
        ui.timer(OBJECTS_S, self._ask)

    def refresh(self) -> None:
        """Show the current state."""
        now_ns, known = time.time_ns(), self._monitor.fleet.warehouses.of(self._name)
        self._there.set_visibility(known is not None)
        self._none.set_visibility(known is None)
        if known is None:
            return
        current = known.is_current(now_ns)
        self._notice.set_text("" if current else "It reports no more: this is what was known last.")
        self._notice.set_visibility(not current)
        self._facts.set_content(facts_of(known, now_ns))
        self._sites.set_content(site_rows(known.report, self._site))
        self._no_site.set_visibility(not known.report.sites)
        self._objects_panel.set_visibility(bool(self._site))
        alerts = open_alerts([known], MOST_ALERTS)
        self._alerts.set_content(alert_rows(alerts, now_ns))
        self._no_alert.set_visibility(not alerts)

    async def _ask(self) -> None:
        """Ask for the objects of the chosen site."""
        if not self._site or self._monitor.fleet.warehouses.of(self._name) is None:
            return
        try:
            answer = await self._asked.of(self._name, self._site)
        except (RequestError, SchemaError) as error:
            self._about.set_text(f"The objects of {self._site} cannot be had now: {error}")
            return
        shown = answer.objects[:MOST_OBJECTS]
        self._objects.set_content(object_rows(shown, answer.now_ns))
        count = len(answer.objects)
        self._about.set_text(
            f"{'' if answer.complete else 'at least '}{plural(count, 'object')} in {self._site}"
            + (f", of which these are the first {MOST_OBJECTS}" if count > MOST_OBJECTS else "")
        )
