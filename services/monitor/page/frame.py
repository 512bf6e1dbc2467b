"""What every page has around it: where to go, who is there, and what is wrong with the monitor itself."""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from nicegui import ui

from schemas.alerts import Alert, Severity
from services.monitor.history.errors import HistoryError
from services.monitor.history.settings import NONE
from services.monitor.monitor import Monitor
from services.monitor.web.auth.visitor import Visitor, visitor_of

REFRESH_S: Final = 1.0
PATIENCE_S: Final = 10.0
"""How long a page may take to be made on a machine that is busy."""

STYLE: Final = (Path(__file__).parent / "style.css").read_text(encoding="utf-8")
THEME_COOKIE: Final = "fleetsight-theme"


@dataclass(frozen=True, slots=True)
class _Theme:
    name: str
    icon: str
    dark: bool | None


THEMES: Final = (
    _Theme("auto", "brightness_auto", None),
    _Theme("light", "light_mode", dark=False),
    _Theme("dark", "dark_mode", dark=True),
)


@dataclass(frozen=True, slots=True)
class Place:
    """A page that one can go to from everywhere."""

    name: str
    path: str
    icon: str


FLEET: Final = Place("Fleet", "/", "smart_toy")
INVENTORY: Final = Place("Inventory", "/inventory", "inventory_2")
ALERTS: Final = Place("Alerts", "/alerts", "notifications")
MAP: Final = Place("Map", "/map", "map")
HEALTH: Final = Place("Health", "/health", "monitor_heart")
PLACES: Final = (FLEET, INVENTORY, ALERTS, MAP, HEALTH)


@contextmanager
def page_frame(monitor: Monitor, title: str, here: Place | None = None) -> Iterator[Visitor]:
    """Fill a page: what is made inside is below the header. Gives who looks. here: the place that it belongs to."""
    client = ui.context.client
    visitor = visitor_of(client.request)
    ui.page_title(f"{title} \N{MIDDLE DOT} fleetsight")
    ui.add_css(STYLE)
    counts = [_bar(visitor, here), _tabs(here)]
    banners = ui.element("div").classes("fs-banners")
    shown: list[str] = []

    async def refresh() -> None:
        if not visitor.may_look:
            ui.navigate.to("/")
            client.content.clear()
            return
        problems = list(monitor.problems())
        if problems != shown:
            shown[:] = problems
            banners.clear()
            with banners:
                for problem in problems:
                    banner(problem)
        with suppress(HistoryError):  # which is among the problems
            _count(counts, await monitor.current_alerts())

    ui.timer(REFRESH_S, refresh)
    yield visitor


def banner(text: str, *, bad: bool = False) -> ui.label:
    """Say what is wrong; return where it is said."""
    with ui.element("div").classes(f"fs-banner {'fs-bad' if bad else ''}").props('role="alert"'):
        ui.icon("error" if bad else "warning")
        return ui.label(text)


def nothing_yet(icon: str, what: str, *do: str, command: str = "") -> None:
    """Say that there is nothing, and what to do about it."""
    with ui.element("div").classes("fs-empty"):
        ui.icon(icon)
        with ui.element("strong"):
            ui.label(what)
        for line in do:
            ui.label(line)
        if command:
            ui.label(command).classes("fs-code")


def export_link(monitor: Monitor, what: str) -> None:
    """Offer what the history has of the last day, as a file. what: sightings or alerts."""
    if monitor.settings.history != NONE:
        link = ui.link("Last day as CSV", f"/api/v1/history/export?what={what}")
        link.classes("fs-link fs-small").props("download")


def _bar(visitor: Visitor, here: Place | None) -> ui.label:
    with ui.header(elevated=False).classes("fs-header"):
        with ui.link(target="/").classes("fs-brand"):
            ui.html("fleet<b>sight</b>", sanitize=False, tag="span")
        count = _links(here)
        with ui.element("div").classes("fs-who"):
            with ui.element("strong").classes("fs-name"):
                ui.label(visitor.name).tooltip(f"signed in as {visitor.role}")
            _theme_button()
            with ui.element("form").props("method=post action=/logout"):
                ui.button(icon="logout").props('type=submit flat round dense aria-label="Log out"').tooltip("Log out")
    return count


def _tabs(here: Place | None) -> ui.label:
    with ui.footer(elevated=False).classes("fs-footer"):
        return _links(here)


def _links(here: Place | None) -> ui.label:
    """Make the links to every place; return the label that says how many alerts are open."""
    count = ui.label().classes("fs-count")
    with ui.element("nav").classes("fs-nav").props('aria-label="Pages"'):
        for place in PLACES:
            with ui.link(target=place.path).classes("fs-here" if place is here else "") as link:
                ui.icon(place.icon)
                ui.label(place.name)
                if place is ALERTS:
                    count.move(link)
    return count


def _count(labels: list[ui.label], alerts: Sequence[Alert]) -> None:
    """Show how many alerts are open, in the colour of the most severe."""
    by_severity = Counter(alert.severity for alert in alerts)
    worst = next((each for each in reversed(Severity) if by_severity[each]), Severity.INFO)
    for label in labels:
        label.set_text(str(by_severity.total() or ""))
        label.classes(replace=f"fs-count fs-{worst}")


def _theme_button() -> None:
    kept = ui.context.client.request.cookies.get(THEME_COOKIE)
    place = next((number for number, theme in enumerate(THEMES) if theme.name == kept), 0)
    dark = ui.dark_mode(THEMES[place].dark)

    def turn() -> None:
        nonlocal place
        place = (place + 1) % len(THEMES)
        theme = THEMES[place]
        dark.set_value(theme.dark)
        button.props(f"icon={theme.icon}")
        tooltip.set_text(f"Theme: {theme.name}")
        ui.run_javascript(f"document.cookie = '{THEME_COOKIE}={theme.name}; path=/; max-age=31536000; samesite=lax'")

    with ui.button(icon=THEMES[place].icon, on_click=turn).props('flat round dense aria-label="Theme"') as button:
        tooltip = ui.tooltip(f"Theme: {THEMES[place].name}")
