"""Small components that several pages use: tiles with figures, links and confirmation dialogs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Final

from nicegui import ui

from schemas.alerts import Alert, Severity

YES: Final = "yes"


class Confirmation:
    """A confirmation dialog. do, leave: the texts of its buttons; advice: the consequences."""

    def __init__(self, do: str, leave: str, advice: str) -> None:
        with ui.dialog() as self._dialog, ui.element("div").classes("fs-panel fs-question"):
            self._what = ui.label().classes("fs-title")
            ui.label(advice).classes("fs-muted")
            with ui.element("div").classes("fs-answers"):
                ui.button(leave, on_click=lambda: self._dialog.submit("")).props("flat no-caps autofocus")
                ui.button(do, on_click=lambda: self._dialog.submit(YES)).props(
                    "unelevated no-caps text-color=on-accent"
                )

    async def given(self, what: str) -> bool:
        """Ask; return whether the user confirmed. Closing the dialog does not confirm."""
        self._what.set_text(what)
        self._dialog.props["aria-label"] = what
        self._dialog.update()
        return bool(await self._dialog == YES)


class Tile:
    """A figure with its label, in one element, as pages have many. dot: the state whose mark is shown beside it."""

    def __init__(self, what: str, *, dot: str = "", on_click: Callable[[], Any] | None = None) -> None:
        mark = f'<span class="fs-dot fs-{dot}"></span>' if dot else ""
        self._what = f'<div class="fs-what">{mark}<div>{escape(what)}</div></div>'
        self._tile = ui.html(self._what, sanitize=False, tag="button" if on_click else "div").classes("fs-tile")
        if on_click:
            self._tile.on("click", lambda _: on_click()).props("type=button")
        self._color = ""

    def show(self, number: str, of: str = "", *, on: bool = False) -> None:
        """Show a figure; on: it is the page's current subject."""
        of_how_many = f'<div class="fs-of">{escape(of)}</div>' if of else ""
        self._tile.set_content(f'{self._what}<div class="fs-number"><div>{escape(number)}</div>{of_how_many}</div>')
        self._tile.classes(add="fs-on" if on else "", remove="" if on else "fs-on")

    def color(self, name: str) -> None:
        """Set the CSS class of the mark, or remove it if the name is empty."""
        if name != self._color:
            self._tile.classes(add=name, remove=self._color)
            self._color = name


@dataclass(frozen=True, slots=True)
class PageLink:
    """A page that is linked from everywhere."""

    name: str
    path: str
    icon: str


FLEET: Final = PageLink("Fleet", "/", "smart_toy")
INVENTORY: Final = PageLink("Inventory", "/inventory", "inventory_2")
ALERTS: Final = PageLink("Alerts", "/alerts", "notifications")
MAP: Final = PageLink("Map", "/map", "map")
HEALTH: Final = PageLink("Health", "/health", "monitor_heart")
WAREHOUSES: Final = PageLink("Warehouses", "/warehouses", "warehouse")
WALL: Final = "/wall"
IN_VIEW: Final = "/in-view"
PLACES: Final = (FLEET, INVENTORY, ALERTS, MAP, HEALTH)


class NavigationLinks:
    """The navigation links; the one to the alerts shows the number of open alerts in the colour of the most severe."""

    def __init__(self, here: PageLink | None, places: Sequence[PageLink] = PLACES) -> None:
        self._here, self._places = here, places
        self._nav = still(self._html((), Severity.INFO), tag="nav").classes("fs-nav").props('aria-label="Pages"')

    def count(self, alerts: Sequence[Alert]) -> None:
        """Show the number of open alerts."""
        worst = max((Severity(alert.severity) for alert in alerts), key=list(Severity).index, default=Severity.INFO)
        self._nav.set_content(self._html(alerts, worst))

    def _html(self, alerts: Sequence[Alert], worst: Severity) -> str:
        count = f'<div class="fs-count fs-{worst}">{len(alerts)}</div>' if alerts else ""
        return "".join(
            f'<a href="{place.path}" class="{"fs-here" if place is self._here else ""}">{icon_of(place.icon)}'
            f"<div>{place.name}</div>{count if place is ALERTS else ''}</a>"
            for place in self._places
        )


def panel(title: str) -> ui.element:
    """Add a panel with a heading; elements made within the context go below the heading."""
    made = ui.element("div").classes("fs-panel")
    with made, ui.element("div").classes("fs-panel-head"), ui.element("h2"):
        ui.label(title)
    return made


def tabs(*pages: tuple[str, str], here: str) -> None:
    """Add links between pages of one subject, each an address and a label. here: the address of this page."""
    links = "".join(
        f'<a href="{path}" class="{"fs-here" if path == here else ""}"'
        f"{' aria-current=page' if path == here else ''}>{escape(label)}</a>"
        for path, label in pages
    )
    still(links, tag="nav").classes("fs-tabs").props('aria-label="Inventory"')


def icon_of(name: str) -> str:
    """Return an icon as HTML, which is cheaper than an element."""
    return f'<i class="q-icon notranslate material-icons" aria-hidden="true">{escape(name)}</i>'


def still(html: str, *, tag: str = "div") -> ui.html:
    """Return one element of our own HTML, in which foreign text is escaped."""
    return ui.html(html, sanitize=False, tag=tag)
