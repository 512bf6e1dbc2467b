"""The panel of the map page in which operators draw zones."""

import logging
from collections.abc import Callable
from functools import partial
from typing import Final

from nicegui import ui

from services.monitor.web.auth.users import Visitor
from services.monitor.web.pages.components import Confirmation
from services.monitor.world.zone_file import NO_FILE, ZoneFile
from services.monitor.world.zones import Corner, Zone, ZoneFileError, zone_of

SITE: Final = "main"
"""The site of zones that are drawn while no world model tells of any."""

HOW: Final = "Click the corners on the map, in order around the zone, or write them here: x, y in metres, one a line."

_log: Final = logging.getLogger(__name__)


class ZoneEditor:
    """Lists the zones, for operators with what changes them. While one is drawn, clicks on the map are its corners.

    changed: is called when the draft is another one.
    """

    def __init__(self, zones: ZoneFile, visitor: Visitor, changed: Callable[[], None]) -> None:
        self._zones = zones
        self._visitor = visitor
        self._changed = changed
        self._edited: Zone | None = None
        self._site = self._shown_site = SITE
        self._listed: tuple[Zone, ...] | None = None
        with ui.element("section").classes("fs-panel") as self._panel:
            with ui.element("div").classes("fs-panel-head"):
                with ui.element("h2"):
                    ui.label("Zones")
                ui.element("div").classes("fs-spring")
                self._new = ui.button("Draw a zone", on_click=partial(self._begin, None)).props("dense flat no-caps")
            self._no_file = ui.label(NO_FILE).classes("fs-line fs-muted")
            self._form = ui.element("div").classes("fs-zone-form")
            with self._form:
                self._name = ui.input("Name").props("dense outlined maxlength=64")
                self._text = ui.textarea("Corners", on_change=changed).props("dense outlined autogrow")
                ui.label(HOW).classes("fs-line fs-muted")
                self._problem = ui.label().classes("fs-line fs-notice").props('role="alert"')
                with ui.element("div").classes("fs-answers"):
                    ui.button("Save", on_click=self._save).props("dense unelevated no-caps text-color=on-accent")
                    ui.button("Undo the last corner", on_click=self._undo).props("dense flat no-caps")
                    ui.button("Cancel", on_click=self._end).props("dense flat no-caps")
            self._rows = ui.element("div").classes("fs-zones")
        self._sure = Confirmation("Remove", "Keep", "Rules that name it find nothing any more.")
        self._panel.set_visibility(visitor.may_act)
        self._form.set_visibility(False)

    @property
    def is_drawing(self) -> bool:
        """Whether clicks on the map are corners."""
        return bool(self._form.visible)

    @property
    def corners(self) -> list[Corner]:
        """The corners so far, without those that are not written whole yet."""
        return [corner for line in self._lines() if (corner := _corner(line)) is not None]

    def add(self, corner: Corner) -> None:
        """Add a corner at the end, unless the map shows another site than the zone's."""
        if self._site != self._shown_site:
            ui.notify(f"The map shows the site {self._shown_site}, and the zone is in {self._site}.", type="warning")
            return
        self._show([*self._lines(), f"{corner[0]:g}, {corner[1]:g}"])

    def refresh(self, site: str) -> None:
        """Show the zones as they are. site: the one that the map shows; empty where there is none."""
        self._shown_site = site or SITE
        if self._zones.zones == self._listed or not self._visitor.may_act:
            return
        self._listed = self._zones.zones
        self._new.set_visibility(self._zones.is_there)
        self._no_file.set_visibility(not self._zones.is_there)
        self._rows.clear()
        with self._rows:
            for zone in self._listed:
                self._row(zone)

    def _row(self, zone: Zone) -> None:
        named = f"{zone.name} of site {zone.site}"
        with ui.element("div").classes("fs-line fs-zone-row"):
            ui.label(zone.name)
            ui.label(f"site {zone.site}, {len(zone.corners)} corners").classes("fs-muted")
            ui.element("div").classes("fs-spring")
            change = ui.button("Change", on_click=partial(self._begin, zone))
            change.props(f'dense flat no-caps aria-label="Change {_attribute(named)}"')
            remove = ui.button("Remove", on_click=partial(self._remove, zone))
            remove.props(f'dense flat no-caps aria-label="Remove {_attribute(named)}"')

    def _lines(self) -> list[str]:
        return [line for line in (self._text.value or "").splitlines() if line.strip()]

    def _show(self, lines: list[str]) -> None:
        self._text.set_value("\n".join(lines))

    def _begin(self, zone: Zone | None) -> None:
        self._edited = zone
        self._site = self._shown_site if zone is None else zone.site
        self._name.set_value("" if zone is None else zone.name)
        self._show([] if zone is None else [f"{x:g}, {y:g}" for x, y in zone.corners])
        self._problem.set_text("")
        self._form.set_visibility(True)
        self._changed()

    def _undo(self) -> None:
        self._show(self._lines()[:-1])

    def _end(self) -> None:
        self._form.set_visibility(False)
        self._changed()

    async def _save(self) -> None:
        try:
            self._check_right()
            self._check_corners()
            zone = zone_of(self._name.value.strip(), self._site, self.corners)
            await self._zones.draw(zone, instead_of=self._edited, by=self._visitor.name)
        except ZoneFileError as error:
            self._problem.set_text(str(error))
            return
        self._end()

    async def _remove(self, zone: Zone) -> None:
        if not await self._sure.given(f"Remove the zone {zone.name}?"):
            return
        try:
            self._check_right()
            await self._zones.remove(zone, by=self._visitor.name)
        except ZoneFileError as error:
            ui.notify(str(error), type="warning")

    def _check_corners(self) -> None:
        wrong = next((line for line in self._lines() if _corner(line) is None), None)
        if wrong is not None:
            raise ZoneFileError(f"{wrong[:40]!r} is no corner; one looks like 1.5, -2")

    def _check_right(self) -> None:
        if not self._visitor.may_act:
            raise ZoneFileError("only operators may draw zones")


def _corner(line: str) -> Corner | None:
    """Return the corner that a line says, or None."""
    try:
        x, y = map(float, line.replace(";", ",").split(","))
    except ValueError:
        return None
    return x, y


def _attribute(text: str) -> str:
    """Return a text as part of an attribute of an element: without what ends it there."""
    return text.replace("\\", "").replace('"', "")
