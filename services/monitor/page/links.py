"""The links to every place of the page, as HTML: one element each time, not thirty."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

from nicegui import ui

from schemas.alerts import Alert, Severity


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
WALL: Final = "/wall"
PLACES: Final = (FLEET, INVENTORY, ALERTS, MAP, HEALTH)


class Links:
    """The links to every place; that to the alerts says how many are open, in the colour of the most severe."""

    def __init__(self, here: Place | None) -> None:
        self._here = here
        self._nav = still(self._html((), Severity.INFO), tag="nav").classes("fs-nav").props('aria-label="Pages"')

    def count(self, alerts: Sequence[Alert]) -> None:
        """Say how many alerts are open."""
        worst = max((Severity(alert.severity) for alert in alerts), key=list(Severity).index, default=Severity.INFO)
        self._nav.set_content(self._html(alerts, worst))

    def _html(self, alerts: Sequence[Alert], worst: Severity) -> str:
        count = f'<div class="fs-count fs-{worst}">{len(alerts)}</div>' if alerts else ""
        return "".join(
            f'<a href="{place.path}" class="{"fs-here" if place is self._here else ""}">{icon_of(place.icon)}'
            f"<div>{place.name}</div>{count if place is ALERTS else ''}</a>"
            for place in PLACES
        )


def icon_of(name: str) -> str:
    """Return an icon as HTML, which costs less than an element."""
    return f'<i class="q-icon notranslate material-icons" aria-hidden="true">{escape(name)}</i>'


def still(html: str, *, tag: str = "div") -> ui.html:
    """Make one element of HTML of ours, in which what comes from elsewhere is escaped."""
    return ui.html(html, sanitize=False, tag=tag)
