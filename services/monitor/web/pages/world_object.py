"""The page of one object of a site: what it is, where, by whom it is seen now, and what became of it."""

import time
from collections.abc import Sequence
from html import escape
from typing import Final
from urllib.parse import urlencode

from nicegui import ui

from schemas.keys import CameraKey, Stream, StreamKey
from schemas.world import ChangeKind, WorldObject
from services.monitor.history.archive import WorldQuery
from services.monitor.history.state import HistoryError
from services.monitor.history.world_history import ObjectEvent
from services.monitor.join_address import endpoint_to_join
from services.monitor.live_views.newest import LiveViews
from services.monitor.live_views.why_no_picture import WAITING, Reason
from services.monitor.map.footprints import address_of_id
from services.monitor.monitor import Monitor
from services.monitor.web.pages.components import MAP, still
from services.monitor.web.pages.frame import nothing_yet, page_at, page_frame
from services.monitor.web.pages.mjpeg import path_of
from services.monitor.web.pages.picture_frame import VIEW_STYLE, PageVisibility, PictureFrame
from services.monitor.web.pages.rows.formatting import ago, seen_lately
from services.monitor.web.pages.rows.world import cameras_in_view, event_rows, object_facts
from services.monitor.world.following import ask_for_object
from services.monitor.world.shown_site import OFF, ShownSite, shown_site, site_names
from services.monitor.world.site_objects import PlacedObject

PATH: Final = "/world/{site}/{object_id:path}"
REFRESH_S: Final = 1.0
EVENTS_S: Final = 5.0
MOST_EVENTS: Final = 100
MOST_CHARACTERS: Final = 100
"""Of the names in an address; those of sites and objects are shorter."""

AGAIN_S: Final = 3.0
"""Seconds after which an interrupted picture is requested again."""

ALT: Final = "The newest picture of {}, with what was found drawn on it"


def add_world_object(monitor: Monitor, views: LiveViews) -> None:
    """Add the page."""

    @page_at(PATH)
    async def object_page(site: str, object_id: str) -> None:
        async with page_frame(monitor, f"Object {object_id[:MOST_CHARACTERS]} of {site[:MOST_CHARACTERS]}", MAP):
            ui.add_css(VIEW_STYLE)
            shown = _ObjectPage(monitor, views, site[:MOST_CHARACTERS], object_id[:MOST_CHARACTERS])
            await shown.refresh()
            visibility = PageVisibility()
        while await visibility.begins():
            while not await visibility.ends(REFRESH_S):
                await shown.refresh(live=True)
            shown.hide_picture()


class _ObjectPage:
    """The page's content."""

    def __init__(self, monitor: Monitor, views: LiveViews, site: str, object_id: str) -> None:
        self._monitor, self._views = monitor, views
        self._site, self._id = site, object_id
        self._camera: CameraKey | None = None
        self._again_s = self._read_s = 0.0
        self._asked = 0
        self._events: Sequence[ObjectEvent] = ()
        self._unread = ""
        with ui.element("div").classes("fs-view") as self._there:
            with ui.element("section").classes("fs-panel"):
                with ui.element("div").classes("fs-panel-head"):
                    self._title = ui.label(object_id).classes("fs-title")
                    ui.element("div").classes("fs-spring")
                    self._map = still("")
                self._notice = ui.label().classes("fs-line fs-notice").props('role="status"')
                self._stage = PictureFrame()
                with self._stage.filling():
                    self._image = ui.element("img").classes("fs-picture").props('alt=""')
                    self._image.on("error", self._broke_off)
                self._by = still("").classes("fs-line")
            with ui.element("section").classes("fs-panel"):
                with ui.element("div").classes("fs-panel-head"), ui.element("h2"):
                    ui.label("Now")
                self._facts = still("", tag="dl").classes("fs-facts")
        self._none = nothing_yet("search_off", "There is no such object", "")
        with ui.element("section").classes("fs-panel") as self._past:
            with ui.element("div").classes("fs-panel-head"), ui.element("h2"):
                ui.label("Events")
            self._list = still("").classes("fs-scroll").props('tabindex=0 role=region aria-label="Events"')
            self._why = ui.label().classes("fs-line fs-muted")

    async def refresh(self, *, live: bool = False) -> None:
        """Bring everything up to date. live: the page is looked at, so that the picture is requested."""
        now_ns, fleet = time.time_ns(), self._monitor.fleet
        join = endpoint_to_join(self._monitor.settings)
        known = self._site in site_names(fleet.world, fleet.sites)
        shown = shown_site(fleet.world, fleet.sites, now_ns, chosen=self._site, join=join) if known else ShownSite()
        placed = None if shown.objects is None else shown.objects.objects.get(self._id)
        await self._read_events()
        self._there.set_visibility(placed is not None)
        self._past.set_visibility(placed is not None or bool(self._events))
        self._none.set_visibility(placed is None)
        self._list.set_content(event_rows(self._events, now_ns))
        self._why.set_text(self._unread or ("" if self._events else "Nothing since the history began."))
        if placed is None:
            self.hide_picture()
            self._say_why(shown, now_ns, known=known)
            return
        await self._show(placed, shown, now_ns, live=live)

    async def _show(self, placed: PlacedObject, shown: ShownSite, now_ns: int, *, live: bool) -> None:
        of, cameras = placed.of, list[CameraKey]()
        if live and shown.current:
            fresh = await ask_for_object(self._monitor.bus, of)
            if fresh is not None:
                of, cameras = fresh.of, cameras_in_view(fresh.of, fresh.now_ns)
        self._title.set_text(f"{of.name} {of.id}")
        place = escape(f"/map?{urlencode({'site': of.site, 'object': of.id})}")
        self._map.set_content(f'<a class="fs-link" href="{place}">On the map</a>')
        self._notice.set_text(shown.notice)
        self._notice.set_visibility(bool(shown.notice))
        self._facts.set_content(object_facts(of, placed.zones, now_ns))
        if live:
            self._show_picture(of, self._choose(cameras), now_ns)

    def _choose(self, cameras: Sequence[CameraKey]) -> CameraKey | None:
        """Return the camera to look through: the same as before if it can be, else one whose pictures are published."""
        if self._camera in cameras:
            return self._camera
        published = [each for each in cameras if self._monitor.fleet.inventory.online(each)]
        return next(iter([*published, *cameras]), None)

    def _show_picture(self, of: WorldObject, camera: CameraKey | None, now_ns: int) -> None:
        if camera != self._camera or (self._again_s and time.monotonic() >= self._again_s):
            self.hide_picture()
            self._camera = camera
            if camera is not None:
                self._asked += 1
                source = path_of(StreamKey(camera, Stream.OVERLAY_DETECTION))
                self._image.props(f'src="{source}?{self._asked}" alt="{ALT.format(camera)}"')
        self._image.set_visibility(camera is not None)
        if camera is None:
            last = of.seen_by[0] if of.seen_by else None
            by = "" if last is None else f"{last.robot}/{last.camera} saw it last, {ago(last.last_ns, now_ns)}."
            self._stage.explain(Reason("No camera has it in view", by))
            self._by.set_content("")
            return
        newest = self._views.pictures.peek(StreamKey(camera, Stream.OVERLAY_DETECTION))
        came = newest is not None and newest.message is not None
        self._stage.explain(None if came else Reason(WAITING, f"The page of {camera} says why, if it lasts."))
        self._by.set_content(f'In view of <a class="fs-link" href="/cameras/{camera}">{escape(str(camera))}</a>')

    def hide_picture(self) -> None:
        """Stop requesting the picture: its connection ends, and the overlay is no longer drawn."""
        self._camera, self._again_s = None, 0.0
        self._image.props(remove="src")

    def _broke_off(self) -> None:
        self._again_s = time.monotonic() + AGAIN_S

    async def _read_events(self) -> None:
        if time.monotonic() < self._read_s:
            return
        self._read_s = time.monotonic() + EVENTS_S
        asked = WorldQuery(site=self._site, object=self._id)
        try:
            self._events = await self._monitor.archive.object_events(asked, MOST_EVENTS)
            self._unread = ""
        except HistoryError as error:
            self._unread = f"The history cannot be read: {error}"

    def _say_why(self, shown: ShownSite, now_ns: int, *, known: bool) -> None:
        """Say why the object is not there, and where to look instead."""
        title = "There is no such object"
        advice = (
            f"Site {self._site} has no object {self._id}, and the history knows of none that was there. "
            "An id is never given to another object."
        )
        last = self._events[0] if self._events else None
        if not self._monitor.fleet.world.on:
            title, advice = "This monitor follows no world model", OFF
        elif known and shown.objects is None:
            title, advice = "The world model of this site is not running", shown.notice
        elif not known:
            names = ", ".join(site_names(self._monitor.fleet.world, self._monitor.fleet.sites)) or "none"
            title, advice = (
                "There is no such site",
                f"No world model serves site {self._site}. Known sites: {names}.",
            )
        elif last is not None and last.kind == ChangeKind.MERGED:
            title, advice = (
                "This object was merged into another",
                f"It turned out to be {last.into}, {seen_lately(last.until_ns, now_ns)}.",
            )
        elif not shown.current:
            title, advice = "The objects of this site are not up to date", shown.notice
        elif last is not None and last.kind != ChangeKind.GONE:
            title = f"{last.name} {self._id} is not known any more"
            advice = (
                "The world model was restarted without its state after this object was last reported, "
                f"{ago(last.until_ns, now_ns)}."
            )
        elif last is not None:
            title = f"{last.name} {self._id} is gone"
            advice = f"Nothing was at its place when somebody looked, {ago(last.until_ns, now_ns)}."
        link = ""
        if last is not None and last.into:
            address = address_of_id(self._site, last.into)
            link = f' <a class="fs-link" href="{address}">{escape(last.into)}</a>'
        icon = '<i class="q-icon notranslate material-icons" aria-hidden="true">search_off</i>'
        self._none.set_content(f"{icon}<strong>{escape(title)}</strong><div>{escape(advice)}{link}</div>")
