"""The inventory page: what is in the warehouse, by class and zone, every object once."""

import asyncio
import time
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

from nicegui import events, ui

from services.monitor.join_address import endpoint_to_join
from services.monitor.monitor import Monitor
from services.monitor.web.pages.chart import MAX_AGE_S, RANGES, Charts, StockSubject, chart, show_chart
from services.monitor.web.pages.components import IN_VIEW, INVENTORY, Tile, still, tabs
from services.monitor.web.pages.frame import REFRESH_S, export_link, nothing_yet, page_at, page_frame
from services.monitor.web.pages.live_table import SEARCH, Choices, Column, LiveTable, Loaded, RowWindow, search_field
from services.monitor.web.pages.rows.formatting import plural
from services.monitor.web.pages.rows.stock import (
    OBJECT_BODY,
    OBJECT_CARD,
    STOCK_BODY,
    STOCK_CARD,
    WHOLE_SITE,
    csv_link,
    object_row,
    stock_lines,
    stock_row,
    tiles_of,
)
from services.monitor.world.selection import ObjectFilters, selected
from services.monitor.world.shown_site import ShownSite, shown_site, site_names
from services.monitor.world.site_objects import SITE, PlacedObject, SiteObjects

MAX_TILES: Final = 8
SORT_EVERY_S: Final = 2.0
"""How often the objects of a site that change all the time are sorted again for a page."""

STOCK_COLUMNS: Final = (
    Column("zone", "Zone"),
    Column("name", "Class"),
    Column("count", "Objects", align="right"),
)
OBJECT_COLUMNS: Final = (
    Column("name", "Class"),
    Column("id", "Object"),
    Column("zones", "Where"),
    Column("first", "First seen", align="right"),
    Column("last", "Last seen", align="right"),
    Column("existence", "Existence", align="right"),
)


def add_inventory(charts: Charts, monitor: Monitor) -> None:
    """Add the page."""

    @page_at(INVENTORY.path)
    async def inventory() -> None:
        async with page_frame(monitor, "Inventory", INVENTORY):
            await _Inventory(charts, monitor).refresh()


@dataclass(frozen=True, slots=True)
class _Sorted:
    """Objects in an order. asked: which, and in which order. version: of the site. until_s: how long they will do."""

    asked: tuple[object, ...]
    version: int
    until_s: float
    found: list[PlacedObject]


class _Inventory:
    """One browser's view of the inventory."""

    def __init__(self, charts: Charts, monitor: Monitor) -> None:
        self._monitor = monitor
        self._charts = charts
        self._seconds = RANGES["1 h"]
        self._join = endpoint_to_join(monitor.settings)
        self._choices = Choices()
        self._filters = ObjectFilters(
            name=self._choices["class"], zone=self._choices["zone"], text=self._choices[SEARCH]
        )
        self._shown = ShownSite()
        self._sorted = _Sorted((), 0, 0.0, [])
        self._tiles: dict[str, Tile] = {}
        tabs((INVENTORY.path, "Whole site"), (IN_VIEW, "In view of cameras"), here=INVENTORY.path)
        self._notice = ui.label().classes("fs-line fs-notice").props('role="status"')
        with ui.element("div").classes("fs-stack") as self._there:
            self._totals = ui.element("div").classes("fs-tiles")
            self._draw_chart()
            self._stock = self._draw_stock()
            self._objects = self._draw_objects()
        self._empty = nothing_yet(
            "inventory_2",
            "The contents of the warehouse are not known",
            "A world model keeps every object once, from what all robots see. Start one where a robot with a map and "
            "a distance service is; until then see what each camera has in view:",
            command=f"fleetsight worldmodel --connect {self._join}",
        )
        ui.timer(REFRESH_S, self.refresh, immediate=False)
        ui.timer(MAX_AGE_S, self.draw)  # a slow database does not delay the page

    def _draw_chart(self) -> None:
        with ui.element("div").classes("fs-panel"):
            with ui.element("div").classes("fs-panel-head"):
                with ui.element("h2"):
                    self._over_time = ui.label()
                ui.element("div").classes("fs-spring")
                export_link(self._monitor, "stock")
                ui.toggle(list(RANGES), value="1 h", on_change=self._over).props(
                    'dense flat no-caps role=group aria-label="How far back"'
                )
            self._chart = chart()
            self._why_not = ui.label().classes("fs-empty")

    def _draw_stock(self) -> LiveTable:
        with ui.element("div").classes("fs-panel"):
            with ui.element("div").classes("fs-panel-head"):
                with ui.element("h2"):
                    ui.label("By class and zone")
                self._all = ui.button("Whole site", icon="close", on_click=self._choose_all).props("flat dense")
                ui.element("div").classes("fs-spring")
                chosen = self._choices["site"] or ""
                self._site = ui.select({"": "", chosen: chosen}, value=chosen, on_change=self._choose_site)
                self._site.props('dense outlined options-dense aria-label="Site"')
            table = LiveTable(
                STOCK_COLUMNS, self._load_stock, row_key="key", sort="zone", body=STOCK_BODY, card=STOCK_CARD
            )
            table.table.on("choose", self._choose)
            self._nothing = ui.label("Nothing is known to be there.").classes("fs-line fs-muted")
        return table

    def _draw_objects(self) -> LiveTable:
        with ui.element("div").classes("fs-panel"):
            with ui.element("div").classes("fs-panel-head"):
                with ui.element("h2"):
                    self._about = ui.label()
                search_field("Class, object, zone or robot", self._look_for, self._filters.text)
                self._found = ui.label().classes("fs-muted")
                ui.element("div").classes("fs-spring")
                self._csv = still("")
            return LiveTable(
                OBJECT_COLUMNS, self._load_objects, row_key="id", sort="name", body=OBJECT_BODY, card=OBJECT_CARD
            )

    async def draw(self) -> None:
        """Draw the chart again."""
        if self._shown.objects is None:
            return
        subject = StockSubject(self._shown.name, self._filters.zone, self._filters.name, self._seconds)
        drawn = await self._charts.of(subject)
        self._over_time.set_text(f"Over time: {self._subject()}")
        show_chart(self._chart, self._why_not, drawn, "Nothing of it is known to have been there during this time.")

    def _subject(self) -> str:
        """Return the class and the zone, or site, that are shown, in words."""
        several = len(self._monitor.fleet.world.sites) > 1
        where = self._filters.zone or (f"site {self._shown.name}" if several else WHOLE_SITE)
        return f"{self._filters.name or 'all classes'}, {where}"

    async def refresh(self) -> None:
        """Show what is there now."""
        fleet, now_ns = self._monitor.fleet, time.time_ns()
        chosen = self._site.value or ""
        self._shown = shown_site(fleet.world, fleet.sites, now_ns, chosen=chosen, join=self._join)
        self._offer_sites(site_names(fleet.world, fleet.sites))
        site = self._shown.objects
        self._notice.set_text(self._shown.notice)
        self._notice.set_visibility(bool(self._shown.notice))
        self._there.set_visibility(site is not None)
        self._empty.set_visibility(site is None and fleet.world.on)
        if site is None:
            return
        if self._filters.zone not in {SITE, *(each.name for each in site.zones)}:
            self._filters = replace(self._filters, zone=SITE)
        self._show_tiles(site)
        self._about.set_text(f"Objects: {self._subject()}")
        self._csv.set_content(csv_link(self._shown.name, self._filters))
        self._all.set_visibility(bool(self._filters.name or self._filters.zone))
        await self._stock.refresh()
        await self._objects.refresh()

    def _offer_sites(self, names: list[str]) -> None:
        known = {name: name for name in names}
        if self._site.value:
            known.setdefault(self._site.value, self._site.value)
        else:
            known = {"": known.pop(self._shown.name, ""), **known}
        if known != self._site.options:
            self._site.set_options(known)
        self._site.set_visibility(len(names) > 1)

    def _show_tiles(self, site: SiteObjects) -> None:
        counts = site.count(self._filters.zone)
        shown = tiles_of(counts, MAX_TILES, self._filters.name)
        if list(shown) != list(self._tiles):
            self._totals.clear()
            with self._totals:
                self._tiles = {name: Tile(name, on_click=partial(self._only, name)) for name in shown}
        for name, tile in self._tiles.items():
            tile.show(f"{counts.get(name, 0):,}", on=name == self._filters.name)

    async def _load_stock(self, window: RowWindow) -> Loaded:
        site, shown = self._shown.objects, self._shown
        filters = self._filters
        lines = (
            []
            if site is None
            else stock_lines(site, name=filters.name, zone=filters.zone, sort=window.sort, descending=window.descending)
        )
        rows = [stock_row(each, shown.name, current=shown.current) for each in lines[window.begin : window.end]]
        return Loaded(rows, len(lines), lambda: self._nothing.set_visibility(not lines))

    async def _load_objects(self, window: RowWindow) -> Loaded:
        found = await self._select(window)
        now_ns, current = time.time_ns(), self._shown.current
        rows = [object_row(each, now_ns, current=current) for each in found[window.begin : window.end]]
        return Loaded(rows, len(found), lambda: self._found.set_text(plural(len(found), "object")))

    async def _select(self, window: RowWindow) -> list[PlacedObject]:
        """Return the objects in the table's order, sorted in another thread, as there may be thousands."""
        site, filters = self._shown.objects, self._filters
        if site is None:
            return []
        asked = (id(site), filters, window.sort, window.descending)
        last, version = self._sorted, site.version
        if last.asked == asked and (last.version == version or time.monotonic() < last.until_s):
            return last.found
        every = list(site.objects.values())
        found = await asyncio.to_thread(selected, every, filters, sort=window.sort, descending=window.descending)
        self._sorted = _Sorted(asked, version, time.monotonic() + SORT_EVERY_S, found)
        return found

    async def _only(self, name: str) -> None:
        await self._narrow(replace(self._filters, name="" if self._filters.name == name else name))

    async def _choose(self, event: events.GenericEventArguments) -> None:
        zone, name = (str(part) for part in event.args)
        await self._narrow(replace(self._filters, zone=zone, name=name))

    async def _choose_all(self) -> None:
        await self._narrow(replace(self._filters, zone=SITE, name=""))

    async def _choose_site(self, event: events.ValueChangeEventArguments[str | None]) -> None:
        self._choices.keep("site", event.value or "")
        await self._narrow(replace(self._filters, zone=SITE, name=""))

    async def _over(self, event: events.ValueChangeEventArguments[str]) -> None:
        self._seconds = RANGES[event.value]
        await self.draw()

    async def _look_for(self, text: str) -> None:
        self._filters = replace(self._filters, text=text)
        self._choices.keep(SEARCH, text)
        await self._objects.begin()

    async def _narrow(self, filters: ObjectFilters) -> None:
        self._filters = filters
        self._choices.keep("class", filters.name)
        self._choices.keep("zone", filters.zone)
        await self.refresh()
        await self._stock.begin()
        await self._objects.begin()
        await self.draw()
