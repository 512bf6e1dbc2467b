"""The page of what is in view: the objects that each camera sees, and counts over time."""

import asyncio
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

from nicegui import events, ui

from services.monitor.inventory.inventory import Entry
from services.monitor.join_address import endpoint_to_join
from services.monitor.monitor import Monitor
from services.monitor.web.pages.chart import MAX_AGE_S, RANGES, Charts, Subject, chart, show_chart
from services.monitor.web.pages.components import IN_VIEW, INVENTORY, Tile, tabs
from services.monitor.web.pages.frame import REFRESH_S, export_link, nothing_yet, page_at, page_frame
from services.monitor.web.pages.live_table import SEARCH, Choices, Column, LiveTable, Loaded, RowWindow, search_field
from services.monitor.web.pages.page_data import PageData
from services.monitor.web.pages.rows.formatting import plural
from services.monitor.web.pages.rows.sightings import (
    SIGHTING_BODY,
    SIGHTING_CARD,
    Filters,
    SightingTable,
    as_csv,
    sighting_row,
)

MAX_TILES: Final = 8
MAX_CSV: Final = 100_000

SUMS: Final = (
    "These counts and the chart are sums over cameras: an object that two cameras see counts twice. "
    "The tab Whole site counts each object once."
)

COLUMNS: Final = (
    Column("robot", "Robot"),
    Column("camera", "Camera"),
    Column("name", "Class"),
    Column("count", "In view", align="right"),
    Column("score", "Confidence", align="right"),
    Column("nearest", "Nearest", align="right"),
    Column("first", "First seen", align="right"),
    Column("last", "Last seen", align="right"),
    Column("worker", "Reported by", sortable=False),
)


def add_in_view(shared: PageData, charts: Charts, monitor: Monitor) -> None:
    """Add the page."""

    @page_at(IN_VIEW)
    async def in_view() -> None:
        async with page_frame(monitor, "In view", INVENTORY):
            await _InView(shared, charts, monitor).refresh()


class _InView:
    """One browser's view of the sightings."""

    def __init__(self, shared: PageData, charts: Charts, monitor: Monitor) -> None:
        self._shared = shared
        self._monitor = monitor
        self._charts = charts
        self._choices = Choices()
        text, name = self._choices[SEARCH], self._choices["class"]
        self._filters = Filters(text=text, name=name, in_view=self._choices["in_view"] != "no")
        self._subject = Subject(name=name, text=text.strip())
        self._tiles: dict[str, Tile] = {}
        tabs((INVENTORY.path, "Whole site"), (IN_VIEW, "In view of cameras"), here=IN_VIEW)
        self._totals = ui.element("div").classes("fs-tiles")
        self._sums = ui.label(SUMS).classes("fs-muted fs-small")
        self._draw_panel()
        with ui.element("div").classes("fs-panel"):
            self._head()
            self._table = LiveTable(
                COLUMNS, self._load, row_key="id", sort="robot", body=SIGHTING_BODY, card=SIGHTING_CARD
            )
            self._table.table.on("choose", self._choose)
            self._nothing = nothing_yet(
                "inventory_2",
                "Nothing has been seen yet",
                "Class lists come from a detector, once a robot with a camera has joined. Start one where there is "
                "a CPU or GPU to spare:",
                command=f"fleetsight detector --connect {endpoint_to_join(monitor.settings)}",
            )
            self._none = nothing_yet(
                "search_off",
                "No sighting matches",
                "Clear the search, or switch off In view now to see what was there before.",
            )
        ui.timer(REFRESH_S, self.refresh, immediate=False)
        ui.timer(MAX_AGE_S, self.draw)  # a slow database does not delay the page

    def _draw_panel(self) -> None:
        with ui.element("div").classes("fs-panel"):
            with ui.element("div").classes("fs-panel-head"):
                with ui.element("h2"):
                    self._about = ui.label()
                self._all = ui.button("Whole fleet", icon="close", on_click=self._choose_all).props("flat dense")
                self._all.set_visibility(False)
                ui.element("div").classes("fs-spring")
                export_link(self._monitor, "sightings")
                ui.toggle(list(RANGES), value="1 h", on_change=self._over).props(
                    'dense flat no-caps role=group aria-label="How far back"'
                )
            self._chart = chart()
            self._why_not = ui.label().classes("fs-empty")

    def _head(self) -> None:
        with ui.element("div").classes("fs-panel-head"):
            search_field("Robot, camera, class, model or worker", self._look_for, self._filters.text)
            ui.switch("In view now", value=self._filters.in_view, on_change=self._in_view)
            self._found = ui.label().classes("fs-muted")
            ui.element("div").classes("fs-spring")
            ui.button("CSV", icon="download", on_click=self._download).props("flat dense").tooltip(
                "Download what is listed"
            )

    async def refresh(self) -> None:
        """Show the objects in view now."""
        await self._table.refresh()

    async def draw(self) -> None:
        """Draw the chart again."""
        drawn = await self._charts.of(self._subject)
        self._about.set_text(f"In view: {self._subject}")
        self._all.set_visibility(bool(self._subject.robot))
        show_chart(self._chart, self._why_not, drawn, "None of it was in view during this time.")

    async def _load(self, window: RowWindow) -> Loaded:
        sightings = await self._shared.sightings()
        found = sightings.wanted(replace(self._filters, sort=window.sort, descending=window.descending))
        now_ns = time.time_ns()
        rows = [sighting_row(entry, now_ns) for entry in found[window.begin : window.end]]
        return Loaded(rows, len(found), partial(self._count, sightings, found))

    def _count(self, sightings: SightingTable, found: Sequence[Entry]) -> None:
        shown = list(sightings.totals)[:MAX_TILES]
        if self._filters.name and self._filters.name not in shown:
            shown = [*shown[: MAX_TILES - 1], self._filters.name]
        if shown != list(self._tiles):
            self._totals.clear()
            with self._totals:
                self._tiles = {name: Tile(name, on_click=partial(self._only, name)) for name in shown}
        for name, tile in self._tiles.items():
            views = sightings.views[name]
            of = f"in {views:,} views" if views > 1 else ""
            tile.show(f"{sightings.totals.get(name, 0):,}", of, on=name == self._filters.name)
        unknown = (
            f", {sightings.unknown:,} more currently unknown" if self._filters.in_view and sightings.unknown else ""
        )
        self._found.set_text(plural(len(found), "sighting") + unknown)
        self._sums.set_visibility(any(views > 1 for views in sightings.views.values()))
        self._nothing.set_visibility(not sightings.entries)
        self._none.set_visibility(bool(sightings.entries) and not found)

    async def _only(self, name: str) -> None:
        self._filters = replace(self._filters, name="" if self._filters.name == name else name)
        self._subject = replace(self._subject, name=self._filters.name)
        self._choices.keep("class", self._filters.name)
        await self._table.begin()
        await self.draw()

    async def _look_for(self, text: str) -> None:
        self._filters = replace(self._filters, text=text)
        self._choices.keep(SEARCH, text)
        await self._table.begin()
        await self._choose_all()

    async def _in_view(self, event: events.ValueChangeEventArguments[bool | None]) -> None:
        self._filters = replace(self._filters, in_view=bool(event.value))
        self._choices.keep("in_view", "" if event.value else "no")
        await self._table.begin()

    async def _over(self, event: events.ValueChangeEventArguments[str]) -> None:
        self._subject = replace(self._subject, seconds=RANGES[event.value])
        await self.draw()

    async def _choose(self, event: events.GenericEventArguments) -> None:
        robot, camera, name = (str(part) for part in event.args)
        self._subject = replace(self._subject, robot=robot, camera=camera, name=name, text="")
        await self.draw()

    async def _choose_all(self) -> None:
        text = self._filters.text.strip()
        self._subject = replace(self._subject, robot="", camera="", name=self._filters.name, text=text)
        await self.draw()

    async def _download(self) -> None:
        found = (await self._shared.sightings()).wanted(self._filters)
        text = await asyncio.to_thread(as_csv, found[:MAX_CSV])
        ui.download.content(f"\N{BYTE ORDER MARK}{text}", "inventory.csv", "text/csv")  # for Excel
