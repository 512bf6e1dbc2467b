"""The 3D page: the objects in view of one camera, as coloured points with a box around each."""

import math
import time
from collections import Counter
from collections.abc import Callable
from typing import Final

from nicegui import ui
from nicegui.elements.scene.objects.box import Box

from schemas.keys import CameraKey, Stream, StreamKey
from schemas.objects import ObjectClouds
from services.monitor.join_address import endpoint_to_join
from services.monitor.live_views.newest import LiveViews, Newest
from services.monitor.live_views.object_scene import Solid, frame_of, rounded, solids_of
from services.monitor.live_views.shared import CrowdedError
from services.monitor.live_views.why_no_picture import Reason, facts_of, why_nothing
from services.monitor.liveness import STALE_S
from services.monitor.map.drawing import colour_of
from services.monitor.monitor import Monitor
from services.monitor.web.pages.components import FLEET
from services.monitor.web.pages.frame import page_at, page_frame
from services.monitor.web.pages.picture_frame import VIEW_STYLE, PageVisibility, PictureFrame, camera_key
from services.monitor.web.pages.rows.formatting import age_text, plural

PATH: Final = "/objects/{robot}/{camera}"
REFRESH_S: Final = 1.0
"""Clouds are large: a browser gets at most one a second."""

SERVICE: Final = "cloud"
POINT_M: Final = 0.025
EYE_DEGREES: Final = 50
FPS: Final = 15
"""Enough for turning the scene by hand, and feasible without a graphics card."""

LEAST_M: Final = 0.01
MOST_BOXES: Final = 40
BACKGROUND: Final = "#0b0f13"
GAMMA: Final = 2.2
"""Cameras' colours are encoded for screens, those of a scene are linear."""

SHOW_POINTS: Final = "window['scene_{id}'].traverse(each => {{ if (each.isPoints) each.frustumCulled = false; }})"
"""The browser would go on to look whether the first points that it got are in view, not those that are there now."""

WITH_A_MOUSE: Final = "Drag to turn, scroll to come nearer, right-drag to move"
WITH_FINGERS: Final = "Drag to turn, pinch to come nearer, drag with two fingers to move"

NEAREST_LOOK_M: Final = 1.2
MOST_REASONS: Final = 5


def add_objects(monitor: Monitor, views: LiveViews) -> None:
    """Add the page."""

    @page_at(PATH)
    async def objects_page(robot: str, camera: str) -> None:
        async with page_frame(monitor, f"{robot}/{camera} in 3D", FLEET):
            ui.add_css(VIEW_STYLE)
            key = camera_key(robot, camera)
            if key is None:
                return
            solids = _Solids(monitor, key)
            visibility = PageVisibility()
        while await visibility.begins():
            try:
                async with views.clouds.hold(StreamKey(key, Stream.OBJECTS)) as newest:
                    solids.begin()
                    while not await visibility.ends(REFRESH_S):
                        solids.refresh(newest)
            except CrowdedError as error:
                solids.say(Reason("Too many views are open", str(error)))
                await visibility.ends()


class _Solids:
    """The page's content."""

    def __init__(self, monitor: Monitor, key: CameraKey) -> None:
        self._monitor, self._key = monitor, key
        self._shown = 0
        self._since_s = time.monotonic()
        self._chosen: int | None = None
        self._seen: ObjectClouds | None = None
        self._received_ns = 0
        self._has_looked = False
        self._rows: list[_Row] = []
        with ui.element("div").classes("fs-view"):
            with ui.element("section").classes("fs-panel"):
                self._build_head()
                self._stage = PictureFrame()
                with self._stage.filling():
                    self._build_scene()
                with ui.element("div").classes("fs-line fs-muted"):
                    self._age, self._frame = ui.label(), ui.label()
                    ui.label(WITH_A_MOUSE).classes("fs-mouse")
                    ui.label(WITH_FINGERS).classes("fs-touch")
            with ui.element("section").classes("fs-panel"):
                with ui.element("div").classes("fs-panel-head"), ui.element("h2"):
                    ui.label("Objects")
                self._list = ui.element("div").classes("fs-scroll")
                self._list.props('tabindex=0 role=region aria-label="Objects"')
                self._unmeasured = ui.label().classes("fs-line fs-muted")

    def _build_head(self) -> None:
        with ui.element("div").classes("fs-panel-head"):
            ui.label(str(self._key)).classes("fs-title")
            ui.element("div").classes("fs-spring")
            self._live = ui.switch("Live", value=True).props("dense")
            with ui.link(target=f"/cameras/{self._key}").classes("fs-link"):
                ui.label("Picture")

    def _build_scene(self) -> None:
        eye = ui.scene.perspective_camera(fov=EYE_DEGREES, near=0.05, far=200)
        with ui.scene(grid=(40, 40), background_color=BACKGROUND, camera=eye, click_events=[], fps=FPS) as self._scene:
            self._scene.classes("fs-scene").axes_helper(0.4)
            self._points = self._scene.point_cloud([], [], POINT_M)
        self._boxes: list[Box] = []

    def begin(self) -> None:
        """Note that clouds are requested from now on."""
        self._since_s = time.monotonic()
        self._shown = 0

    def say(self, reason: Reason) -> None:
        """Explain why nothing is shown."""
        self._stage.explain(reason)

    def refresh(self, newest: Newest[ObjectClouds]) -> None:
        """Show the newest clouds, unless the view is frozen."""
        if newest.message is not None and newest.number != self._shown and self._live.value:
            self._shown, self._seen, self._received_ns = newest.number, newest.message, newest.received_ns
            self._draw()
        seen = self._seen
        age = self._monitor.fleet.age_of(seen.header, self._received_ns, time.time_ns()) if seen else None
        self._age.set_text(f"{age_text(age)} old" if age and self._live.value else "")
        if age is not None and (age.seconds <= STALE_S or not self._live.value):
            self._stage.explain(None if seen and seen.objects else _nothing_in_view(seen))
            return
        workers = self._monitor.workers().of(SERVICE)
        facts = facts_of(
            self._monitor.fleet,
            self._key,
            workers,
            came=age is not None,
            waited_s=time.monotonic() - self._since_s,
            deaf=self._monitor.health.problem,
            join=endpoint_to_join(self._monitor.settings),
        )
        reason = why_nothing(self._key, Stream.OBJECTS, SERVICE, facts)
        self._stage.explain(
            Reason("The message received is not a point cloud", newest.problem) if newest.problem else reason,
            f"The clouds are {age_text(age)} old" if age else "",
        )

    def _choose(self, index: int | None) -> None:
        self._chosen = None if index == self._chosen else index
        self._has_looked = False
        self._draw()

    def _draw(self) -> None:
        if self._seen is None:
            return
        if self._chosen is not None and all(each.index != self._chosen for each in self._seen.objects):
            self._chosen = None
        solids = solids_of(self._seen, self._chosen)
        self._points.set_points(
            [point for solid in solids for point in rounded(solid.xyz)],
            [colour for solid in solids for colour in rounded(solid.rgb**GAMMA)],
        )
        ui.run_javascript(SHOW_POINTS.format(id=self._scene.html_id))
        self._draw_boxes(solids)
        self._frame.set_text(f"in {frame_of(self._seen)}, {plural(sum(len(each.xyz) for each in solids), 'point')}")
        self._fill_list(solids_of(self._seen))
        if solids and not self._has_looked:
            self._look_at(solids)

    def _draw_boxes(self, solids: list[Solid]) -> None:
        with self._scene:
            self._boxes += [self._scene.box(wireframe=True) for _ in solids[len(self._boxes) : MOST_BOXES]]
        for number, box in enumerate(self._boxes):
            box.visible(number < len(solids))
        for solid, box in zip(solids, self._boxes, strict=False):
            box.move(*solid.box.centre).rotate_R([list(row) for row in solid.box.rotation])
            box.scale(*(max(LEAST_M, side) for side in solid.box.size)).material(colour_of(solid.name))

    def _look_at(self, solids: list[Solid]) -> None:
        """Look at all of them from where the robot is, from a little above and aside."""
        self._has_looked = True
        x, y, z = (sum(solid.box.centre[axis] for solid in solids) / len(solids) for axis in range(3))
        size = max(max(math.dist(each.box.centre, (x, y, z)), *each.box.size) for each in solids)
        away = max(NEAREST_LOOK_M, 2.0 * size)
        far = math.hypot(x, y) or 1.0
        self._scene.move_camera(
            x - away * (x / far + 0.4 * y / far), y - away * (y / far - 0.4 * x / far), z + 0.7 * away, x, y, z
        )

    def _fill_list(self, solids: list[Solid]) -> None:
        with self._list:
            self._rows += [_Row(self._choose) for _ in solids[len(self._rows) :]]
        for number, row in enumerate(self._rows):
            row.show(solids[number] if number < len(solids) else None, self._chosen)
        reasons = Counter(self._seen.unmeasured.values() if self._seen else ()).most_common(MOST_REASONS)
        self._unmeasured.set_text(
            "; ".join(f"{plural(count, 'object')} without points: {why}" for why, count in reasons)
        )


class _Row:
    """One object in the list. Its element stays in place when its data changes, so that it can be clicked."""

    def __init__(self, choose: Callable[[int], None]) -> None:
        self._index = 0
        self._row = ui.element("button").classes("fs-row").on("click", lambda: choose(self._index))
        with self._row:
            self._key = ui.element("span").classes("fs-key")
            self._name, self._far = ui.label(), ui.label().classes("fs-far")
            self._more = ui.label().classes("fs-more")

    def show(self, solid: Solid | None, chosen: int | None) -> None:
        """Show an object, or none."""
        self._row.set_visibility(solid is not None)
        if solid is None:
            return
        self._index = solid.index
        self._row.classes(**{"add" if solid.index == chosen else "remove": "fs-on"})
        self._key.style(f"background: {colour_of(solid.name)}")
        self._name.set_text(solid.name)
        self._far.set_text(f"{solid.distance_m:.2f} m")
        long, wide, high = solid.box.size
        self._more.set_text(f"{long:.2f} x {wide:.2f} x {high:.2f} m, {plural(solid.count, 'point')}")


def _nothing_in_view(seen: ObjectClouds | None) -> Reason:
    why = next(iter(seen.unmeasured.values()), "") if seen else ""
    return Reason("No object has a cloud now", why or "No object of a class that the model knows is in view.")
