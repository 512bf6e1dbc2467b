"""The camera page: the live picture with its overlay, and the objects in view with their distances."""

import time
from collections import deque
from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

from nicegui import ui

from schemas.detections import ClassList
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream, StreamKey
from schemas.models import SavedPicture
from services.monitor.fleet import Age
from services.monitor.inventory.sighting import Sighting
from services.monitor.join_address import endpoint_to_join
from services.monitor.live_views.newest import FrameLists, LiveViews, Newest
from services.monitor.live_views.shared import CrowdedError
from services.monitor.live_views.why_no_picture import Reason, facts_of, why_nothing
from services.monitor.liveness import STALE_S
from services.monitor.monitor import Monitor
from services.monitor.requests.picture_requests import SavePictureError, save_picture
from services.monitor.web.auth.users import Visitor
from services.monitor.web.pages.components import FLEET, still
from services.monitor.web.pages.frame import page_at, page_frame
from services.monitor.web.pages.mjpeg import path_of
from services.monitor.web.pages.picture_frame import VIEW_STYLE, PageVisibility, PictureFrame, camera_key
from services.monitor.web.pages.rows.formatting import age_text, ago, rate_text

PATH: Final = "/cameras/{robot}/{camera}"
REFRESH_S: Final = 0.5
TICK_S: Final = 0.1
"""Seconds between updates of the counts in the picture."""

AGAIN_S: Final = 3.0
"""Seconds after which an interrupted picture is requested again."""

SERVICE: Final = "detector"
ALT: Final = "The newest picture of {}, with what was found drawn on it"
SETTLED: Final = "A count moves when class lists in a row agree, so one frame alone neither adds nor removes anything."
KINDS: Final = {Stream.OVERLAY_DETECTION.value: "Boxes", Stream.OVERLAY_SEGMENTATION.value: "Masks"}


def add_camera(monitor: Monitor, views: LiveViews) -> None:
    """Add the page."""

    @page_at(PATH)
    async def camera_page(robot: str, camera: str) -> None:
        async with page_frame(monitor, f"{robot}/{camera}", FLEET) as visitor:
            ui.add_css(VIEW_STYLE)
            key = camera_key(robot, camera)
            if key is None:
                return
            live = _Live(monitor, views, key, visitor)
            visibility = PageVisibility()
        while await visibility.begins():
            try:
                async with views.lists.hold(StreamKey(key, Stream.CLASSES)) as lists:
                    await live.run(visibility, lists)
            except CrowdedError:
                await live.run(visibility, FrameLists())


class _Live:
    """The page's content for one camera. The picture's own connection requests the overlay."""

    def __init__(self, monitor: Monitor, views: LiveViews, key: CameraKey, visitor: Visitor) -> None:
        self._monitor, self._views, self._key, self._visitor = monitor, views, key, visitor
        self._stream = StreamKey(key, Stream.OVERLAY_DETECTION)
        self._asked = 0
        self._since_s = time.monotonic()
        self._again_s = 0.0
        self._arrivals: deque[tuple[float, int]] = deque(maxlen=8)
        with ui.element("div").classes("fs-view"):
            with ui.element("section").classes("fs-panel"):
                self._build_head()
                self._stage = PictureFrame()
                with self._stage.filling():
                    self._image = ui.element("img").classes("fs-picture fs-old").props(f'alt="{ALT.format(key)}"')
                    self._image.on("error", self._broke_off)
                with ui.element("div").classes("fs-line fs-muted"):
                    self._age, self._rate, self._size = ui.label(), ui.label(), ui.label()
            with ui.element("section").classes("fs-panel"):
                self._in_picture = ui.element("div")
                with self._in_picture:
                    with ui.element("div").classes("fs-panel-head"), ui.element("h2"):
                        self._which_picture = ui.label()
                    self._counted = still("").classes("fs-line fs-frame")
                with ui.element("div").classes("fs-panel-head"), ui.element("h2").props(f'title="{SETTLED}"'):
                    self._when = ui.label()
                self._classes = still("").classes("fs-classes")
                self._otherwise = ui.label().classes("fs-line")
                self._served = ui.label().classes("fs-line fs-muted")

    def _build_head(self) -> None:
        with ui.element("div").classes("fs-panel-head"):
            ui.label(str(self._key)).classes("fs-title")
            ui.element("div").classes("fs-spring")
            ui.toggle(KINDS, value=self._stream.stream.value, on_change=lambda event: self._choose(event.value)).props(
                'dense unelevated no-caps toggle-text-color=on-accent role=group aria-label="Overlay"'
            ).classes("fs-toggle")
            if self._visitor.may_act:
                self._save = ui.button("Save for training", on_click=self._save_picture).props("dense flat no-caps")
            with ui.link(target=f"/objects/{self._key}").classes("fs-link"):
                ui.label("In 3D")

    async def _save_picture(self) -> None:
        """Have the camera's next picture saved in a data set, with what a detector finds in it as a draft of labels."""
        if not self._visitor.may_act:
            ui.notify("Only operators may do that.", type="warning")
            return
        self._save.disable()
        try:
            saved = await save_picture(self._monitor.bus, self._key, self._visitor.name)
        except SavePictureError as error:
            ui.notify(f"Not saved: {error}", type="warning", multi_line=True)
        else:
            ui.notify(f"Saved: {saved.file} in {saved.folder}{drafted(saved)}", type="positive", multi_line=True)
        finally:
            self._save.enable()

    def _choose(self, stream: str) -> None:
        self._stream = StreamKey(self._key, Stream(stream))
        self.show()

    async def run(self, visibility: PageVisibility, lists: FrameLists) -> None:
        """Show the camera while the page is visible. lists: counts in its newest frames."""
        self.show()
        refreshed_s = 0.0
        while not await visibility.ends(TICK_S):
            self._tell_of_frame(lists)
            if time.monotonic() - refreshed_s >= REFRESH_S:
                refreshed_s = time.monotonic()
                self.refresh()
        self.hide()

    def show(self) -> None:
        """Request the picture."""
        self._since_s = time.monotonic()
        self._ask()

    def _ask(self) -> None:
        self._asked += 1
        self._again_s = 0.0
        self._arrivals.clear()
        self._image.props(f'src="{path_of(self._stream)}?{self._asked}"')

    def hide(self) -> None:
        """Stop requesting the picture: its connection ends, and the overlay is no longer drawn."""
        self._image.props(remove="src")

    def _broke_off(self) -> None:
        self._again_s = time.monotonic() + AGAIN_S

    def refresh(self) -> None:
        """Bring everything up to date."""
        if self._again_s and time.monotonic() >= self._again_s:
            self._ask()
        newest, now_ns = self._views.pictures.peek(self._stream), time.time_ns()
        age = self._age_of(newest, now_ns)
        fresh = age is not None and age.seconds <= STALE_S
        self._image.classes(**{"remove" if fresh else "add": "fs-old"})
        self._which_picture.set_text("In this picture" if fresh else "In the last picture")
        self._explain(newest, age, fresh=fresh)
        self._tell(newest, age)
        self._list(now_ns)

    def _age_of(self, newest: Newest[ImageFrame] | None, now_ns: int) -> Age | None:
        if newest is None or newest.message is None:
            return None
        return self._monitor.fleet.age_of(newest.message.header, newest.received_ns, now_ns)

    def _explain(self, newest: Newest[ImageFrame] | None, age: Age | None, *, fresh: bool) -> None:
        workers = self._monitor.workers().of(SERVICE)
        waited_s = time.monotonic() - self._since_s
        facts = facts_of(
            self._monitor.fleet,
            self._key,
            workers,
            came=age is not None,
            waited_s=waited_s,
            deaf=self._monitor.health.problem,
            join=endpoint_to_join(self._monitor.settings),
        )
        served = ", ".join(f"{worker.worker} ({worker.model})" for worker in facts.serving)
        self._served.set_text(f"Found by {served}" if served else "No detector serves this camera")
        if fresh:
            self._stage.explain(None)
        elif newest is not None and newest.problem:
            self._stage.explain(Reason("The message received is not a picture", newest.problem))
        else:
            reason = why_nothing(self._key, self._stream.stream, SERVICE, facts)
            self._stage.explain(reason, f"The picture is {age_text(age)} old" if age else "")

    def _tell_of_frame(self, lists: FrameLists) -> None:
        """Show the model's counts in the very frame that the picture shows."""
        newest = self._views.pictures.peek(self._stream)
        frame = None if newest is None else newest.message
        self._in_picture.set_visibility(frame is not None)
        if frame is not None:
            self._counted.set_content(counted_in(lists.of(frame.header)))

    def _tell(self, newest: Newest[ImageFrame] | None, age: Age | None) -> None:
        if newest is None or newest.message is None:
            for label in (self._age, self._rate, self._size):
                label.set_text("")
            return
        self._arrivals.append((time.monotonic(), newest.number))
        (first_s, first), (last_s, last) = self._arrivals[0], self._arrivals[-1]
        self._age.set_text(f"{age_text(age)} old")
        self._rate.set_text(rate_text((last - first) / (last_s - first_s)) if last_s > first_s else "")
        self._size.set_text(f"{newest.message.width} \N{MULTIPLICATION SIGN} {newest.message.height}")

    def _list(self, now_ns: int) -> None:
        inventory = self._monitor.fleet.inventory
        view = inventory.camera(self._key)
        since_ns = now_ns - inventory.limits.stale_ns
        seen = sorted(view.sightings(since_ns), key=lambda each: each.name) if view else []
        available = view is not None and inventory.is_available(view, now_ns)
        self._when.set_text(f"In view{'' if available or not seen else ' when last heard'}, settled")
        self._classes.set_content(rows([each for each in seen if each.count], now_ns, available=available))
        counted = otherwise(view.disagreements(since_ns)) if view is not None and available else ""
        self._otherwise.set_text(counted)
        self._otherwise.set_visibility(bool(counted))


def drafted(saved: SavedPicture) -> str:
    """Return in words what a saved picture has as a draft of its labels."""
    match saved.objects:
        case None:
            return ""
        case 1:
            return ", with a draft of one label"
        case count:
            return f", with drafts of {count} labels"


def counted_in(frame: ClassList | None) -> str:
    """Return a model's counts in one frame as HTML; None if they are unknown."""
    if frame is None:
        return '<span class="fs-muted">Unknown</span>'
    chips = "".join(
        f'<span class="fs-chip" title="the surest: {each.score:.0%}"><b>{each.count}</b>{escape(each.name)}</span>'
        for each in frame.classes
    )
    return chips or '<span class="fs-muted">Nothing</span>'


def otherwise(disagreements: Mapping[str, tuple[int, int]]) -> str:
    """Return another model's different counts, in words; empty if there are none."""
    counts = ", ".join(f"{theirs} {name}" for name, (_, theirs) in sorted(disagreements.items()))
    return f"Another model counts {counts}" if counts else ""


def rows(sightings: Sequence[Sighting], now_ns: int, *, available: bool) -> str:
    """Return the objects in view as HTML, one element for all of them."""
    if not sightings:
        return f'<div class="fs-line fs-muted">{"Nothing" if available else "Unknown"}</div>'
    return "".join(
        f'<div class="fs-row {"" if available else "fs-stale"}"><div class="fs-many">{each.count}</div>'
        f"<div>{escape(each.name)}</div>"
        f'<div class="fs-far">{"" if each.nearest_m is None else f"{each.nearest_m:.2f} m"}</div>'
        f'<div class="fs-more">{each.score:.0%} sure, appeared {ago(each.first_ns, now_ns)}</div></div>'
        for each in sightings
    )
