"""The map page: robots' poses and the last places of objects."""

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

from nicegui import ui
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from schemas.world import SiteStatus
from services.monitor.formats import natural
from services.monitor.join_address import endpoint_to_join
from services.monitor.live_views.newest import LiveViews
from services.monitor.live_views.robot_poses import MOST_ROBOTS, HeldRobots
from services.monitor.map.drawing import MOST_SHOWN, STALE, Bounds, colour_of, is_fresh, svg_of
from services.monitor.map.floor_plan import FloorPlan
from services.monitor.map.last_seen import LastPoses, MapObject
from services.monitor.map.pose import Pose, Whereabouts
from services.monitor.map.sites import totals
from services.monitor.monitor import Monitor
from services.monitor.web.pages.components import MAP, still
from services.monitor.web.pages.frame import nothing_yet, page_at, page_frame
from services.monitor.web.pages.picture_frame import VIEW_STYLE, PageVisibility
from services.monitor.web.pages.rows.formatting import ago, plural
from services.monitor.world.site_objects import ZoneCount

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

EVERY: Final = ""
MOST_LISTED: Final = 100
ROBOT_ICON: Final = "navigation"


def add_map(monitor: Monitor, views: LiveViews) -> None:
    """Add the page."""

    @page_at(MAP.path)
    async def map_page() -> None:
        async with page_frame(monitor, "Map", MAP):
            ui.add_css(VIEW_STYLE)
            shown = _Map(monitor, views.last_poses)
            visibility = PageVisibility()
        while await visibility.begins():
            async with HeldRobots(views.robots) as held:
                shown.refresh(await held.keep(shown.robots()), held.crowded)
                while not await visibility.ends(REFRESH_S):
                    shown.refresh(await held.keep(shown.robots()), held.crowded)


class _Map:
    """The page's content. Its bounds only grow, so that it does not jump."""

    def __init__(self, monitor: Monitor, last_poses: LastPoses) -> None:
        self._monitor = monitor
        self._last_poses = last_poses
        plan = monitor.floor_plan
        self._plan = None if plan is None else (plan, url_of(plan))
        self._bounds: Bounds | None = None
        self._placed = False
        with ui.element("div").classes("fs-view"):
            with ui.element("section").classes("fs-panel"):
                with ui.element("div").classes("fs-panel-head"):
                    _title("Map")
                    self._keys = still("").classes("fs-keys fs-small")
                    ui.element("div").classes("fs-spring")
                    self._robot = ui.select({EVERY: "All robots"}, value=EVERY, on_change=self._forget_bounds).props(
                        'dense outlined options-dense aria-label="Robot"'
                    )
                self._sites = ui.label().classes("fs-line")
                self._zones = ui.label().classes("fs-line")
                self._picture = ui.html(sanitize=False).classes("fs-map")
                self._empty = nothing_yet(
                    ROBOT_ICON,
                    "No position is known yet",
                    "Robots appear once their gateways send transforms from map to base_link, or they see two objects.",
                    "Objects appear once a distance service measures where they are:",
                    command=f"fleetsight distance --connect {endpoint_to_join(monitor.settings)}",
                )
            with ui.element("section").classes("fs-panel"):
                with ui.element("div").classes("fs-panel-head"):
                    _title("Last seen")
                self._list = still("").classes("fs-scroll").props('tabindex=0 role=region aria-label="Last seen"')
                self._missing = ui.label().classes("fs-line fs-muted")

    def robots(self) -> list[str]:
        """Return the robots to follow: the chosen one, or as many of those online as the limit allows."""
        online = self._monitor.fleet.inventory.robots()
        self._offer(sorted(online | self._last_poses.names(time.time_ns()), key=natural))
        return [self._robot.value] if self._robot.value else sorted(online, key=natural)[:MOST_ROBOTS]

    def _offer(self, robots: list[str]) -> None:
        known = {EVERY: "All robots", **{name: name for name in robots}}
        if self._robot.value not in known:
            known[self._robot.value] = self._robot.value
        if known != self._robot.options:
            self._robot.set_options(known)

    def _forget_bounds(self) -> None:
        self._bounds = None

    def refresh(self, whereabouts: Mapping[str, Whereabouts], crowded: str) -> None:
        """Draw the current state."""
        now_ns = time.time_ns()
        poses = {name: where.pose() for name, where in whereabouts.items()}
        online = self._monitor.fleet.inventory.robots()
        known = {name: pose for name, pose in poses.items() if isinstance(pose, Pose) and name in online}
        self._monitor.fleet.places.stand(known)
        self._last_poses.take_seen(self._monitor.fleet.places.poses)
        self._last_poses.take(known, now_ns)
        robots = self._last_poses.robots(now_ns, online, robot=self._robot.value)
        robots, more = robots[:MOST_SHOWN], len(robots) - MOST_SHOWN
        marks = self._monitor.fleet.places.marks(now_ns, robot=self._robot.value)[:MOST_SHOWN]
        points = [*((mark.x, mark.y) for mark in marks), *((robot.pose.x, robot.pose.y) for robot in robots)]
        self._placed = self._placed or bool(points)
        if self._plan is not None and not (points and self._robot.value):
            points += self._plan[0].corners
        sites = self._monitor.fleet.sites
        zones = list(self._monitor.fleet.world.zones(sites, now_ns))
        if not (points and self._robot.value):
            points += [corner for each in zones for corner in each.zone.corners]
        self._bounds = Bounds.around(points, self._bounds)
        self._empty.set_visibility(not self._placed)
        self._picture.set_visibility(self._bounds is not None)
        if self._bounds is not None:
            self._picture.set_content(svg_of(self._bounds, marks, robots, now_ns, self._plan, zones=zones))
        self._explain(marks, now_ns)
        self._sites.set_text("; ".join(in_words(status) for status in sites.current(now_ns)))
        self._zones.set_text("; ".join(zone_in_words(each) for each in zones[:MOST_LISTED]))
        placed = {robot.name for robot in robots if robot.live}
        without = [f"{name}: {why}" for name, why in poses.items() if isinstance(why, str) and name not in placed]
        left_out = f"and {plural(more, 'robot')} more: choose one above" if more > 0 else ""
        self._missing.set_text("; ".join(filter(None, [*without[:5], crowded, left_out])))

    def _explain(self, marks: Sequence[MapObject], now_ns: int) -> None:
        self._keys.set_content(keys(marks, now_ns))
        more = len(marks) - MOST_LISTED
        rest = f'<div class="fs-line fs-muted">and {plural(more, "more", "more")}</div>' if more > 0 else ""
        self._list.set_content("".join(row(mark, now_ns) for mark in marks[:MOST_LISTED]) + rest)


def in_words(status: SiteStatus) -> str:
    """Return what a world model says of a site, each object counted once."""
    problems = f" ({'; '.join(status.problems)})" if status.problems else ""
    return f"In {status.site}: {totals(status.objects)}{problems}"


def zone_in_words(counted: ZoneCount) -> str:
    """Return what is in a zone, or why that is not known."""
    zone = counted.zone
    known = totals(counted.objects) if counted.current else f"not known, as no world model tells of site {zone.site}"
    return f"Zone {zone.name}: {known}"


def _title(text: str) -> None:
    with ui.element("h2"):
        ui.label(text)


def keys(marks: Sequence[MapObject], now_ns: int) -> str:
    """Return the legend as HTML, with the number of recently seen objects of each class."""
    counts = Counter(mark.name for mark in marks if is_fresh(mark, now_ns))
    told = [(colour_of(name), f"{counts[name]} {name}") for name in sorted({mark.name for mark in marks})]
    if stale := sum(not is_fresh(mark, now_ns) for mark in marks):
        told.append((STALE, f"{stale} not seen for a while"))
    return "".join(f"<span>{_dot(colour)}<span>{escape(text)}</span></span>" for colour, text in told)


def row(mark: MapObject, now_ns: int) -> str:
    """Return a mark as HTML for the list, which is one element."""
    fresh = is_fresh(mark, now_ns)
    return (
        f'<div class="fs-row {"" if fresh else "fs-stale"}">{_dot(colour_of(mark.name) if fresh else STALE)}'
        f'<div>{escape(mark.name)}</div><div class="fs-far">{ago(mark.seen_ns, now_ns)}</div>'
        f'<div class="fs-more">at {mark.x:.1f}, {mark.y:.1f} m, by {escape(f"{mark.robot}/{mark.camera}")}</div></div>'
    )


def _dot(colour: str) -> str:
    return f'<span class="fs-key" style="background: {colour}"></span>'
