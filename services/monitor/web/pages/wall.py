"""The wall screen: items that need attention, then the other robots, with pages that turn by themselves."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Final

from nicegui import events, ui

from schemas.alerts import Alert, Severity
from services.monitor.history.state import HistoryError
from services.monitor.liveness import RobotState
from services.monitor.monitor import Monitor
from services.monitor.web.auth.users import Visitor
from services.monitor.web.pages.components import WALL, still
from services.monitor.web.pages.frame import REFRESH_S, page_at, page_frame
from services.monitor.web.pages.overview import no_robots_yet
from services.monitor.web.pages.page_data import PageData
from services.monitor.web.pages.rows.alerts import doubt_of, severity_figures
from services.monitor.web.pages.rows.formatting import NOTHING
from services.monitor.web.pages.rows.overview import alert_line, lost_line, pressing, robot_cell, turned
from services.monitor.web.pages.rows.robots import RobotFilter, Survey

TURN_S: Final = 10.0
"""Seconds for which one page of items is shown."""

LOST: Final = (RobotState.OFFLINE, RobotState.SILENT)
THERE: Final = (RobotState.TROUBLE, RobotState.ONLINE)
MOST: Final = 200
"""Maximum number of lines, or cells, on the largest of screens."""

STYLE: Final = (Path(__file__).parent / "wall.css").read_text(encoding="utf-8")

EVENT: Final = "fs-fits"
TELL: Final = f"""
const cells = document.querySelector('.fs-cells');
const tell = () => {{
  if (!cells.clientWidth) return;
  const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
  const columns = Math.max(1, Math.floor(cells.clientWidth / (20 * rem)));
  const rows = Math.floor(cells.clientHeight / (5.4 * rem));
  emitEvent('{EVENT}', [Math.floor(innerHeight * .36 / (2.4 * rem)), columns * rows]);
}};
new ResizeObserver(tell).observe(cells);
"""
"""Reports how many lines and cells fit, from the heights and widths in the style sheet."""


def add_wall(shared: PageData, monitor: Monitor) -> None:
    """Add the page."""

    @page_at(WALL)
    async def wall() -> None:
        async with page_frame(monitor, "Wall", bars=False) as visitor:
            ui.add_css(STYLE)
            await _Wall(shared, monitor, visitor).refresh()


@dataclass(frozen=True, slots=True)
class _Fits:
    """The number of attention lines, and of robot cells, that fit."""

    lines: int = 6
    cells: int = 12


class _Wall:
    """The content of one screen."""

    def __init__(self, shared: PageData, monitor: Monitor, visitor: Visitor) -> None:
        self._shared, self._monitor, self._visitor = shared, monitor, visitor
        self._fits = _Fits()
        with ui.element("div").classes("fs-wall-head"):
            with ui.link(target="/").classes("fs-brand"):
                still("fleet<b>sight</b>", tag="span")
            self._figures = still("").classes("fs-figures")
        with ui.element("div").classes("fs-panel fs-wall-panel"):
            self._which_needs = _head("Needs attention")
            self._needs = still("")
        with ui.element("div").classes("fs-panel fs-wall-panel fs-rest"):
            self._which_robots = _head("Robots")
            self._robots = still("").classes("fs-cells")
            self._no_robots = no_robots_yet(monitor)
        ui.on(EVENT, self._take_room)
        ui.run_javascript(TELL)
        ui.timer(REFRESH_S, self.refresh, immediate=False)

    async def refresh(self) -> None:
        """Show everything as it is now."""
        self._visitor.stay()
        survey = await self._shared.survey()
        alerts, unknown = await self._alerts()
        self._figures.set_content(figures(survey, alerts))
        turn = int(time.monotonic() / TURN_S)
        lost = [name for state in LOST for name in await survey.robots(RobotFilter(state=state))]
        there = [name for state in THERE for name in await survey.robots(RobotFilter(state=state))]
        self._show_needs(survey, pressing(alerts or (), lost), unknown, turn)
        self._show_robots(survey, there, turn)
        self._robots.set_visibility(survey.size > 0)
        self._no_robots.set_visibility(not survey.size)

    async def _alerts(self) -> tuple[Sequence[Alert] | None, str]:
        """Return the open alerts; else None, and why they are unknown."""
        try:
            return await self._monitor.current_alerts(), ""
        except HistoryError as error:
            return None, str(error)

    def _show_needs(self, survey: Survey, needs: Sequence[Alert | str], unknown: str, turn: int) -> None:
        shown, which = turned(needs, self._fits.lines, turn)
        inventory, now_ns = self._monitor.fleet.inventory, survey.now_ns
        lines = [
            lost_line(survey.robot(each), now_ns)
            if isinstance(each, str)
            else alert_line(each, doubt_of(each, inventory, now_ns), now_ns)
            for each in shown
        ]
        if unknown:
            why = f"Open alerts are unknown: {unknown}"
            lines.insert(0, f'<div class="fs-calm fs-warn">{escape(why)}</div>')
        elif not needs:
            lines.append('<div class="fs-calm">No critical alert is open and no robot is offline or silent.</div>')
        self._needs.set_content("".join(lines))
        self._which_needs.set_text(str(which))

    def _show_robots(self, survey: Survey, names: Sequence[str], turn: int) -> None:
        shown, which = turned(names, self._fits.cells, turn)
        self._robots.set_content("".join(robot_cell(survey.robot(name)) for name in shown))
        self._which_robots.set_text(str(which))

    async def _take_room(self, event: events.GenericEventArguments) -> None:
        lines, cells = (min(max(1, int(each)), MOST) for each in event.args)
        self._fits = _Fits(lines, cells)
        await self.refresh()


def figures(survey: Survey, alerts: Sequence[Alert] | None) -> str:
    """Return the number of robots of each state, and of open alerts of each severity, as HTML."""
    robots = [
        _figure(f"{survey.counts.get(state, 0):,}", state, mark=f"fs-dot fs-{state}", color=_COLORS[state])
        for state in reversed(RobotState)
    ]
    counts = severity_figures(alerts)
    told = [
        _figure(counts[severity], f"{severity} alerts", color=color)
        for severity, color in ((Severity.CRITICAL, "fs-bad"), (Severity.WARNING, "fs-warn"))
    ]
    return "".join([*robots, *told])


_COLORS: Final = {
    RobotState.ONLINE: "",
    RobotState.TROUBLE: "fs-warn",
    RobotState.SILENT: "fs-warn",
    RobotState.OFFLINE: "fs-bad",
}


def _figure(number: str, what: str, *, mark: str = "", color: str = "") -> str:
    dot = f'<span class="{mark}"></span>' if mark else ""
    shade = "" if number in ("0", NOTHING) else color
    return f'<span class="fs-figure {shade}">{dot}<b>{number}</b>{escape(what)}</span>'


def _head(title: str) -> ui.label:
    """Make a panel's head; return where it is said which part of it is shown."""
    with ui.element("div").classes("fs-panel-head"):
        with ui.element("h2"):
            ui.label(title)
        return ui.label().classes("fs-muted")
