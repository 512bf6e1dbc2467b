"""The frame around every page: navigation, user, problems of the monitor; limits the pages that a visitor has open."""

from collections import defaultdict
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Final, Protocol

from fastapi import Depends, FastAPI, Request
from fastapi.responses import HTMLResponse
from nicegui import ui

from services.monitor.event_loop.cooperative_yielding import pause
from services.monitor.history.settings import NONE
from services.monitor.history.state import HistoryError
from services.monitor.monitor import Monitor
from services.monitor.web.auth.routes import notice
from services.monitor.web.auth.users import Visitor, visitor_of
from services.monitor.web.pages.components import PLACES, WAREHOUSES, NavigationLinks, PageLink, icon_of, still

MOST_OPEN: Final = 50
"""Maximum number of pages per visitor."""

MOST_LEFT: Final = 10
"""Maximum of these without a browser connection: pages fetched but never opened would be kept for a minute."""


class BrowserPage(Protocol):
    """A page in a browser, as the page's library represents it."""

    @property
    def has_socket_connection(self) -> bool:
        """Whether a browser is connected."""

    @property
    def is_deleted(self) -> bool:
        """Whether the page is closed."""

    def delete(self) -> None:
        """Close the page."""


@dataclass(slots=True, eq=False)
class OpenPage:
    """One page. made: it is complete, so that it may be closed."""

    client: BrowserPage
    made: bool = False


class OpenPages:
    """All pages that were sent and are not closed, by visitor."""

    def __init__(self) -> None:
        self._of = defaultdict[str, list[OpenPage]](list)

    def make_room(self, name: str) -> bool:
        """Close a visitor's abandoned pages; return whether one more page is allowed."""
        here = [visit for visit in self._of.pop(name, ()) if not visit.client.is_deleted]
        left = [visit for visit in here if visit.made and not visit.client.has_socket_connection]
        for visit in left[: max(0, len(left) - MOST_LEFT + 1)]:
            visit.client.delete()
            here.remove(visit)
        if here:
            self._of[name] = here
        return len(here) < MOST_OPEN

    def begin(self, name: str, client: BrowserPage) -> OpenPage:
        """Note that a page is made for a visitor."""
        visit = OpenPage(client)
        self._of[name].append(visit)
        return visit


class TooManyPagesError(Exception):
    """A visitor has the maximum number of pages open."""


def answer_instead(pages: FastAPI) -> None:
    """Register error pages with the pages' application."""
    pages.add_exception_handler(TooManyPagesError, _too_many)
    pages.add_exception_handler(404, _nothing_here)
    pages.add_exception_handler(Exception, _broken)


def _too_many(_: Request, __: Exception) -> HTMLResponse:
    text = f"You have {MOST_OPEN} pages of this monitor open. Close some of them, then load this one again."
    return HTMLResponse(notice("Too many pages are open", text), 503)


def _nothing_here(request: Request, _: Exception) -> HTMLResponse:
    return HTMLResponse(notice("There is no such page", f"The monitor has nothing at {request.url.path[:200]}."), 404)


def _broken(_: Request, __: Exception) -> HTMLResponse:
    text = "Load it again. If that does not help, the monitor's log says what is wrong; the API and alerts go on."
    return HTMLResponse(notice("This page could not be made", text), 500)


REFRESH_S: Final = 1.0
RECONNECT_TIMEOUT_S: Final = 30.0
"""Seconds allowed for making a page on a busy machine."""

STYLE: Final = (Path(__file__).parent / "style.css").read_text(encoding="utf-8")
THEME_COOKIE: Final = "fleetsight-theme"

LOG_IN_AGAIN: Final = """<script>
setInterval(async () => {
  if (window.socket?.connected) return;
  const answer = await fetch('/api/v1/me', {cache: 'no-store'}).catch(() => null);
  if (answer?.status === 401) location.reload();
}, 2000);
</script>"""
"""Loads a page again whose connection is gone and whose visitor is logged out, so that the server sends them to the
log-in. The page's own library would try for ever to connect, and be refused."""


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


OPEN_PAGES: Final = OpenPages()
"""For the whole process, like the pages themselves."""


def page_at(path: str) -> ui.page:
    """Return a decorator that makes a function a page, for visitors below the limit of open pages."""

    async def make_room(request: Request) -> None:
        if not OPEN_PAGES.make_room(visitor_of(request).name):
            raise TooManyPagesError

    return ui.page(path, response_timeout=RECONNECT_TIMEOUT_S, dependencies=[Depends(make_room)])


@asynccontextmanager
async def page_frame(
    monitor: Monitor, title: str, here: PageLink | None = None, *, bars: bool = True
) -> AsyncIterator[Visitor]:
    """Fill a page: elements made inside are below the header. Yields the visitor.

    here: the place that it belongs to. bars: it has a header and a footer to go elsewhere.
    An element takes a third of a millisecond to make: other tasks get their turn in between.
    """
    client = ui.context.client
    visitor = visitor_of(client.request)
    visit = OPEN_PAGES.begin(visitor.name, client)
    ui.page_title(f"{title} \N{MIDDLE DOT} fleetsight")
    ui.add_css(STYLE)
    ui.add_body_html(LOG_IN_AGAIN)
    links: list[NavigationLinks] = []
    still(escape(title), tag="h1").classes("fs-unseen")
    if bars:
        places = (WAREHOUSES, *PLACES) if monitor.fleet.warehouses else PLACES
        links.append(_bar(visitor, here, places))
        await pause()
        with ui.footer(elevated=False).classes("fs-footer"):
            links.append(NavigationLinks(here, places))
    else:
        ui.dark_mode(THEMES[_chosen_theme()].dark)
    banners = _Banners(monitor)

    async def refresh() -> None:
        if not visitor.may_look:
            ui.navigate.reload()
            client.content.clear()
            return
        banners.refresh()
        if not links:
            return
        with suppress(HistoryError):  # already shown among the problems
            alerts = await monitor.current_alerts()
            for each in links:
                each.count(alerts)

    ui.timer(REFRESH_S, refresh)
    await pause()
    yield visitor
    visit.made = True
    await pause()


class _Banners:
    """Problems of the monitor itself."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._shown: tuple[bool, list[str]] = (False, [])
        self._banners = ui.element("div").classes("fs-banners")
        self._deaf: ui.label | None = None
        self.refresh()

    def refresh(self) -> None:
        """Show the current problems."""
        deaf, problems = self._monitor.health.problem, self._monitor.problems()
        if (bool(deaf), problems) != self._shown:
            self._shown = bool(deaf), problems
            self._banners.clear()
            with self._banners:
                self._deaf = banner("", bad=True) if deaf else None
                for problem in problems:
                    banner(problem)
        if self._deaf is not None:
            self._deaf.set_text(f"The fleet cannot be heard, the last known state is shown: {deaf}")


def banner(text: str, *, bad: bool = False) -> ui.label:
    """Add a banner; return its label."""
    with ui.element("div").classes(f"fs-banner {'fs-bad' if bad else ''}").props('role="alert"'):
        ui.icon("error" if bad else "warning")
        return ui.label(text)


def nothing_yet(icon: str, what: str, *do: str, command: str = "", more: str = "") -> ui.html:
    """Add a notice that there is nothing, with advice; return its element. more: text below the command."""
    lines = "".join(f"<div>{escape(line)}</div>" for line in do)
    code = f'<div class="fs-code">{escape(command)}</div>' if command else ""
    below = f"<div>{escape(more)}</div>" if more else ""
    return still(f"{icon_of(icon)}<strong>{escape(what)}</strong>{lines}{code}{below}").classes("fs-empty")


def export_link(monitor: Monitor, what: str) -> None:
    """Add a link to the last day of history as a file. what: sightings, alerts or stock."""
    if monitor.settings.history != NONE:
        link = ui.link("Last day as CSV", f"/api/v1/history/export?what={what}&bom=true")
        link.classes("fs-link fs-small").props("download")


def _bar(visitor: Visitor, here: PageLink | None, places: Sequence[PageLink]) -> NavigationLinks:
    with ui.header(elevated=False).classes("fs-header"):
        with ui.link(target="/").classes("fs-brand"):
            still("fleet<b>sight</b>", tag="span")
        links = NavigationLinks(here, places)
        with ui.element("div").classes("fs-who"):
            ui.label(visitor.name).classes("fs-name").tooltip(f"signed in as {visitor.role}")
            _theme_button()
            with ui.element("form").props("method=post action=/logout"):
                ui.button(icon="logout").props('type=submit flat round dense aria-label="Log out"').tooltip("Log out")
    return links


def _chosen_theme() -> int:
    kept = ui.context.client.request.cookies.get(THEME_COOKIE)
    return next((number for number, theme in enumerate(THEMES) if theme.name == kept), 0)


def _theme_button() -> None:
    place = _chosen_theme()
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
