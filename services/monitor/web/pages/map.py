"""The map page: robots' poses and the last places of objects."""

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from nicegui import events, ui
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from services.monitor.formats import natural
from services.monitor.join_address import endpoint_to_join
from services.monitor.live_views.newest import LiveViews
from services.monitor.live_views.robot_poses import MOST_ROBOTS, HeldRobots
from services.monitor.map.drawing import (
    MOST_SHOWN,
    Bounds,
    draft_of,
    ground_of,
    metres_at,
    svg_of,
)
from services.monitor.map.floor_plan import FloorPlan, looked_at
from services.monitor.map.footprints import DrawnObject, footprint, newest_of
from services.monitor.map.last_seen import LastPoses, MapObject
from services.monitor.map.pose import DrawnRobot, Pose, Whereabouts
from services.monitor.monitor import Monitor
from services.monitor.web.auth.users import Visitor
from services.monitor.web.pages.components import MAP, still
from services.monitor.web.pages.frame import nothing_yet, page_at, page_frame
from services.monitor.web.pages.live_table import Choices
from services.monitor.web.pages.picture_frame import VIEW_STYLE, PageVisibility
from services.monitor.web.pages.rows.formatting import NS, plural
from services.monitor.web.pages.rows.map import (
    floor_in_words,
    in_words,
    keys,
    object_keys,
    object_row,
    rest_row,
    row,
    zone_in_words,
)
from services.monitor.web.pages.zone_editor import ZoneEditor
from services.monitor.world.following import ask_for_floor
from services.monitor.world.shown_site import ShownSite, shown_site, site_names
from services.monitor.world.site_objects import SITE
from services.monitor.world.zones import ZoneCount

FOR_EVER: Final = {"Cache-Control": "private, max-age=31536000, immutable"}


def url_of(plan: FloorPlan) -> str:
    """Return the URL of a floor plan's image."""
    return f"/floor-plan/{plan.digest}.png"


def floor_plan_route(plan: FloorPlan) -> Route:
    """Return the route that serves the floor plan's image."""

    async def image(_: Request) -> Response:
        return Response(plan.png, media_type="image/png", headers=FOR_EVER)

    return Route(url_of(plan), image)


REFRESH_S: Final = 1.0

REDRAW_S: Final = 2.0
"""How often the objects of a site that change all the time are drawn again."""

FLOOR_EVERY_S: Final = 10.0
"""How often it is asked when the floor was looked at, while that is shown."""

AGING_S: Final = 10
"""How often objects are drawn again because they are older by now."""

MOST_LISTED: Final = 100
ROBOT_ICON: Final = "navigation"

TELL_WHERE: Final = """(event) => {
  const svg = event.currentTarget.querySelector('svg');
  const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  emit(at.x, at.y);
}"""
"""Tells where on the map somebody clicked, in the picture's own units."""


def add_map(monitor: Monitor, views: LiveViews) -> None:
    """Add the page."""

    @page_at(MAP.path)
    async def map_page() -> None:
        async with page_frame(monitor, "Map", MAP) as visitor:
            ui.add_css(VIEW_STYLE)
            shown = _Map(monitor, views.last_poses, visitor)
            visibility = PageVisibility()
        while await visibility.begins():
            async with HeldRobots(views.robots) as held:
                await shown.refresh(await held.keep(shown.robots()), held.crowded)
                while not await visibility.ends(REFRESH_S):
                    await shown.refresh(await held.keep(shown.robots()), held.crowded)


class _Map:
    """The page's content. Its bounds only grow, so that it does not jump.

    Where a world model tells of a site, its objects are drawn, else what cameras have in view. The objects are drawn
    again only when they, their ages or the area changed: they stay selected, and a map on which nothing changes costs
    nothing.
    """

    def __init__(self, monitor: Monitor, last_poses: LastPoses, visitor: Visitor) -> None:
        self._monitor = monitor
        self._last_poses = last_poses
        plan = monitor.floor_plan
        self._plan = None if plan is None else (plan, url_of(plan))
        self._join = endpoint_to_join(monitor.settings)
        self._bounds: Bounds | None = None
        self._placed = False
        self._made: tuple[object, ...] = ()
        self._drawn: tuple[object, ...] = ()
        self._next_s = 0.0
        self._shown = ShownSite()
        self._objects: tuple[list[DrawnObject], int] = [], 0
        self._looks: FloorPlan | None = None
        self._floor_site, self._floor_next_s = "", 0.0
        self._here: set[str] = set()
        self._known: set[str] = set()
        choices = Choices()
        self._chosen = choices["object"]
        self._editor: ZoneEditor | None = None
        with ui.element("div").classes("fs-view"):
            with ui.element("section").classes("fs-panel"):
                with ui.element("div").classes("fs-panel-head"):
                    _title("Map")
                    self._keys = still("").classes("fs-keys fs-small")
                    ui.element("div").classes("fs-spring")
                    self._site = _select("Site", "", choices["site"], self._forget_bounds)
                    self._class = _select("Class", "All classes", choices["class"], self._forget_bounds)
                    self._robot = _select("Robot", "All robots", choices["robot"], self._forget_bounds)
                    self._floor = ui.checkbox("When the floor was looked at", on_change=self._forget_floor).props(
                        "dense"
                    )
                self._notice = ui.label().classes("fs-line fs-notice").props('role="status"')
                self._sites = ui.label().classes("fs-line")
                self._zones = ui.label().classes("fs-line")
                self._floor_words = ui.label().classes("fs-line")
                with ui.element("div").classes("fs-map") as self._picture:
                    self._ground = still("")
                    self._over = still("").classes("fs-over")
                    self._draft = still("").classes("fs-over")
                self._picture.on("click", self._click, js_handler=TELL_WHERE)
                self._empty = nothing_yet(
                    ROBOT_ICON,
                    "No position is known yet",
                    "Robots appear once their gateways send transforms from map to base_link, or they see two objects.",
                    "Objects appear once a distance service measures where they are:",
                    command=f"fleetsight distance --connect {self._join}",
                )
            with ui.element("div").classes("fs-column"):
                if monitor.fleet.world.on:
                    self._editor = ZoneEditor(monitor.zones, visitor, self._draw_draft)
                with ui.element("section").classes("fs-panel"):
                    with ui.element("div").classes("fs-panel-head"):
                        _title("Last seen")
                    self._list = still("").classes("fs-scroll").props('tabindex=0 role=region aria-label="Last seen"')
                    self._missing = ui.label().classes("fs-line fs-muted")

    def robots(self) -> list[str]:
        """Return the robots to follow: the chosen one, or as many of those online as the limit allows."""
        fleet, now_ns = self._monitor.fleet, time.time_ns()
        names = site_names(fleet.world, fleet.sites)
        _offer(self._site, "", names)
        self._site.set_visibility(len(names) > 1)
        self._shown = shown_site(fleet.world, fleet.sites, now_ns, chosen=self._site.value or "", join=self._join)
        if len(names) > 1:
            self._site.set_value(self._shown.name)
        of_site = set(fleet.sites.robots(self._shown.name)) if len(names) > 1 else None
        online = {each for each in fleet.inventory.robots() if of_site is None or each in of_site}
        self._here = online
        known = {each for each in self._last_poses.names(now_ns) if of_site is None or each in of_site}
        _offer(self._robot, "All robots", sorted(online | known, key=natural))
        self._known = known
        return [self._robot.value] if self._robot.value else sorted(online, key=natural)[:MOST_ROBOTS]

    def _forget_bounds(self) -> None:
        self._bounds = None

    def _forget_floor(self) -> None:
        self._looks, self._floor_next_s = None, 0.0
        self._floor_words.set_text("")

    def _click(self, event: events.GenericEventArguments) -> None:
        if self._editor is not None and self._editor.is_drawing and self._bounds is not None:
            self._editor.add(metres_at(self._bounds, *map(float, event.args)))

    def _draw_draft(self) -> None:
        drawing = self._editor is not None and self._editor.is_drawing and self._bounds is not None
        self._picture.classes(add="fs-drawing" if drawing else "", remove="" if drawing else "fs-drawing")
        corners = [] if self._editor is None or not drawing else self._editor.corners
        self._draft.set_content(draft_of(self._bounds, corners) if corners and self._bounds is not None else "")

    async def refresh(self, whereabouts: Mapping[str, Whereabouts], crowded: str) -> None:
        """Draw the current state."""
        now_ns, fleet = time.time_ns(), self._monitor.fleet
        poses = {name: where.pose() for name, where in whereabouts.items()}
        known = {name: pose for name, pose in poses.items() if isinstance(pose, Pose) and name in self._here}
        fleet.places.stand(known)
        self._last_poses.take_seen(fleet.places.poses)
        self._last_poses.take(known, now_ns)
        every = self._last_poses.robots(now_ns, self._here, robot=self._robot.value)
        every = [each for each in every if each.name in self._known | self._here]
        robots, more = every[:MOST_SHOWN], len(every) - MOST_SHOWN
        seen = self._shown.objects is None
        marks = fleet.places.marks(now_ns, robot=self._robot.value)[:MOST_SHOWN] if seen else []
        marks = [mark for mark in marks if self._class.value in ("", mark.name)]
        await self._take_objects(marks, now_ns)
        zones = [each for each in fleet.world.zones(fleet.sites, now_ns) if self._shown.name in ("", each.zone.site)]
        await self._look_at_floor()
        bounds = self._bound(marks, robots, zones)  # a choice forgets them, also while the ground is drawn
        if bounds is not None:
            await self._draw_ground(bounds, zones)
            self._over.set_content(svg_of(bounds, marks, robots, now_ns))
        if self._editor is not None:
            self._editor.refresh(self._shown.name)
            self._draw_draft()
        self._explain(marks, now_ns)
        self._notice.set_text(self._shown.notice)
        self._notice.set_visibility(bool(self._shown.notice))
        self._sites.set_text("; ".join(in_words(status) for status in fleet.sites.current(now_ns)))
        self._zones.set_text("; ".join(zone_in_words(each) for each in zones[:MOST_LISTED]))
        placed = {robot.name for robot in robots if robot.live}
        without = [f"{name}: {why}" for name, why in poses.items() if isinstance(why, str) and name not in placed]
        left_out = f"and {plural(more, 'robot')} more: choose one above" if more > 0 else ""
        self._missing.set_text("; ".join(filter(None, [*without[:5], crowded, left_out])))

    async def _take_objects(self, marks: Sequence[MapObject], now_ns: int) -> None:
        """Choose the objects to draw, unless nothing can have changed; in another thread, as there may be thousands."""
        site = self._shown.objects
        counts = {} if site is None else site.count(SITE)
        names = {mark.name for mark in marks} if site is None else {name for name, count in counts.items() if count}
        _offer(self._class, "All classes", sorted(names))
        made = (
            id(site),
            0 if site is None else site.version,
            self._shown.current,
            self._class.value,
            self._robot.value,
            now_ns // (AGING_S * NS),
        )
        if made == self._made or (_but_version(made) == _but_version(self._made) and time.monotonic() < self._next_s):
            return
        self._made, self._next_s = made, time.monotonic() + REDRAW_S
        self._objects = await asyncio.to_thread(
            newest_of,
            [] if site is None else list(site.objects.values()),
            now_ns,
            name=self._class.value,
            robot=self._robot.value,
            known=self._shown.current,
        )

    async def _look_at_floor(self) -> None:
        """Ask when the floor of the site was looked at, while somebody wants to see it."""
        self._floor.set_visibility(self._shown.objects is not None)
        if self._shown.name != self._floor_site:
            self._floor_site = self._shown.name
            self._forget_floor()
        if not self._floor.value or self._shown.objects is None or time.monotonic() < self._floor_next_s:
            return
        self._floor_next_s = time.monotonic() + FLOOR_EVERY_S
        looks = await ask_for_floor(self._monitor.bus, self._shown.name)
        if not self._floor.value:  # any more
            return
        self._looks = None if looks is None else await asyncio.to_thread(looked_at, looks)
        self._floor_words.set_text(floor_in_words(looks))

    def _bound(
        self, marks: Sequence[MapObject], robots: Sequence[DrawnRobot], zones: Sequence[ZoneCount]
    ) -> Bounds | None:
        points = [*((mark.x, mark.y) for mark in marks), *((robot.pose.x, robot.pose.y) for robot in robots)]
        points += [corner for each in self._objects[0] for corner in footprint(each.of)]
        self._placed = self._placed or bool(points)
        if not (points and self._robot.value):
            points += [] if self._plan is None else self._plan[0].corners
            points += [corner for each in zones for corner in each.zone.corners]
        self._bounds = Bounds.around(points, self._bounds)
        self._empty.set_visibility(not self._placed)
        self._picture.set_visibility(self._bounds is not None)
        return self._bounds

    async def _draw_ground(self, bounds: Bounds, zones: Sequence[ZoneCount]) -> None:
        drawn = (self._made, bounds, [(each.current, dict(each.objects)) for each in zones], self._looks)
        if drawn == self._drawn:
            return
        self._drawn = drawn
        objects, chosen = self._objects[0], self._chosen
        svg = await asyncio.to_thread(
            ground_of, bounds, self._plan, looks=self._looks, zones=zones, objects=objects, chosen=chosen
        )
        self._ground.set_content(svg)

    def _explain(self, marks: Sequence[MapObject], now_ns: int) -> None:
        if self._shown.objects is not None:
            objects, count = self._objects
            self._keys.set_content(object_keys(objects))
            self._list.set_content(
                "".join(object_row(each, now_ns) for each in objects[:MOST_LISTED]) + rest_row(count - MOST_LISTED)
            )
            return
        self._keys.set_content(keys(marks, now_ns))
        rows = "".join(row(mark, now_ns) for mark in marks[:MOST_LISTED])
        self._list.set_content(rows + rest_row(len(marks) - MOST_LISTED))


def _select(label: str, every: str, value: str, changed: Callable[[], None]) -> ui.select:
    """Return a field to choose with. every: what stands for no choice; empty if there has to be one."""
    options = {value: value} if value else {}
    field = ui.select({**({"": every} if every or not value else {}), **options}, value=value, on_change=changed)
    return field.props(f'dense outlined options-dense aria-label="{label}"')


def _offer(field: ui.select, every: str, names: Sequence[str]) -> None:
    known = {**({"": every} if every or not names else {}), **{name: name for name in names}}
    if field.value not in known:
        known[field.value] = field.value
    if known != field.options:
        field.set_options(known)


def _but_version(made: tuple[object, ...]) -> tuple[object, ...]:
    return made[:1] + made[2:]


def _title(text: str) -> None:
    with ui.element("h2"):
        ui.label(text)
