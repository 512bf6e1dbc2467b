"""Routes about the current fleet: robots, cameras, sightings, gateways, workers. Only requested items are made."""

import time
from bisect import bisect_left
from dataclasses import dataclass
from itertools import takewhile
from operator import attrgetter
from typing import Annotated, Final

from fastapi import APIRouter, Path, Request, Response

from schemas.keys import CameraKey
from services.monitor.event_loop.cooperative_yielding import in_turns
from services.monitor.inventory.inventory import Entry, Inventory
from services.monitor.monitor import Monitor
from services.monitor.snapshot import WorkerLine
from services.monitor.web.api.bodies import (
    camera_body,
    encoded_answer,
    gateway_answer,
    page_response,
    robot_body,
    sighting_body,
    site_answer,
    worker_answer,
    zone_answer,
)
from services.monitor.web.api.models import CameraAnswer, GatewayAnswer, Page, RobotAnswer, SightingAnswer, WorkerAnswer
from services.monitor.web.api.paging import After, ClassName, Limit, Name, first_of, operator_of, page_of, place_of
from services.monitor.web.api.world_models import SiteAnswer, ZoneAnswer
from services.monitor.world.site_status import KnownSite
from services.monitor.world.zones import ZoneCount

PLACE: Final = attrgetter("robot", "camera")

SightingKey = tuple[str, str, str]
"""Robot, camera and class."""


@dataclass(frozen=True, slots=True)
class SightingQuery:
    """Selects sightings: by each name that is not empty; in_view: only those in view.

    available: those that can be relied on now, or those that cannot; None for both. after: those behind this place.
    """

    robot: str = ""
    camera: str = ""
    name: str = ""
    in_view: bool = False
    available: bool | None = None
    after: SightingKey | None = None


async def some_entries(inventory: Inventory, asked: SightingQuery, most: int, now_ns: int) -> list[Entry]:
    """Return the first `count` entries by place; other tasks run meanwhile."""
    found: list[Entry] = []
    order = inventory.in_order(asked.robot)
    begin = bisect_left(order, asked.after[:2], key=PLACE) if asked.after else 0
    async for key in in_turns(takewhile(lambda _: len(found) < most, order[begin:])):
        if asked.camera in ("", key.camera):
            found.extend(each for each in inventory.entries_of(key, now_ns) if _is_wanted(each, asked))
    return found[:most]


def _is_wanted(entry: Entry, asked: SightingQuery) -> bool:
    of = entry.sighting
    follows = asked.after is None or (of.key.robot, of.key.camera, of.name) > asked.after
    is_like = asked.name in ("", of.name) and asked.available in (None, entry.available)
    return follows and is_like and (of.count > 0 or not asked.in_view)


DEFAULT_LIMIT: Final = 200

RobotName = Annotated[str, Path(min_length=1, max_length=64)]


def fleet_routes(monitor: Monitor) -> APIRouter:
    """Return the routes."""
    router = APIRouter(tags=["fleet"])
    router.include_router(_member_routes(monitor))
    router.include_router(_account_routes(monitor))

    @router.get("/inventory", response_model=Page[SightingAnswer])
    async def inventory(
        *,
        robot: Name = "",
        camera: Name = "",
        name: ClassName = "",
        in_view: bool = False,
        available: bool | None = None,
        limit: Limit = DEFAULT_LIMIT,
        after: After = None,
    ) -> Response:
        """The objects that are or were in view, by robot, camera and class, debounced from class lists."""
        behind = None if after is None else place_of(after, (str, str, str))
        asked = SightingQuery(robot, camera, name, in_view, available, behind)
        now_ns = time.time_ns()
        found = await some_entries(monitor.fleet.inventory, asked, limit + 1, now_ns)
        items, mark = first_of(found, _entry_place, limit)
        return page_response(now_ns, [sighting_body(each) async for each in in_turns(items)], mark)

    return router


def _member_routes(monitor: Monitor) -> APIRouter:
    router = APIRouter()

    @router.get("/robots", response_model=Page[RobotAnswer])
    async def robots(*, online: bool | None = None, limit: Limit = DEFAULT_LIMIT, after: After = None) -> Response:
        """Every robot ever seen, by name; an offline robot stays until it is forgotten."""
        fleet_view = monitor.fleet_view()
        there = monitor.fleet.inventory.is_alive
        names, mark = page_of(
            fleet_view.robots, _name_place, limit, after, 1, wanted=lambda each: online in (None, there(each))
        )
        bodies = [robot_body(fleet_view.robot(each)) async for each in in_turns(names)]
        return page_response(fleet_view.now_ns, bodies, mark)

    @router.post("/robots/{robot}/forget", status_code=204)
    async def forget(robot: RobotName, request: Request) -> None:
        """Take an offline robot off every list until its gateway is back, and resolve its alerts."""
        monitor.forget(robot, operator_of(request, monitor))

    @router.get("/cameras", response_model=Page[CameraAnswer])
    async def cameras(
        *, robot: Name = "", online: bool | None = None, limit: Limit = DEFAULT_LIMIT, after: After = None
    ) -> Response:
        """Every camera, by robot and name."""
        fleet_view = monitor.fleet_view()
        there = monitor.fleet.inventory.online
        every = fleet_view.cameras_of(robot) if robot else fleet_view.cameras
        keys, mark = page_of(every, _camera_place, limit, after, 2, wanted=lambda each: online in (None, there(each)))
        bodies = [camera_body(fleet_view.camera(each)) async for each in in_turns(keys)]
        return page_response(fleet_view.now_ns, bodies, mark)

    return router


def _account_routes(monitor: Monitor) -> APIRouter:
    router = APIRouter()

    @router.get("/gateways", response_model=Page[GatewayAnswer])
    async def gateways(*, robot: Name = "", limit: Limit = DEFAULT_LIMIT, after: After = None) -> Response:
        """The status of each robot's gateway: every stream, its rates and drops."""
        fleet_view, fleet = monitor.fleet_view(), monitor.fleet
        known = [each for each in fleet_view.robots if robot in ("", each) and each in fleet.gateways]
        names, mark = page_of(known, _name_place, limit, after, 1)

        def answer(name: str) -> GatewayAnswer:
            last_ns = fleet_view.last_ns(name, fleet_view.cameras_of(name))
            return gateway_answer(fleet.gateways[name], last_ns, online=fleet.inventory.is_alive(name))

        items = [encoded_answer(answer(each)) async for each in in_turns(names)]
        return page_response(fleet_view.now_ns, items, mark)

    @router.get("/sites", response_model=Page[SiteAnswer])
    async def sites(*, limit: Limit = DEFAULT_LIMIT, after: After = None) -> Response:
        """The objects in each site that a world model keeps: each once, whichever robot saw it."""
        now_ns = time.time_ns()
        found, mark = page_of(monitor.fleet.sites.every(), _site_place, limit, after, 1)
        return page_response(now_ns, [encoded_answer(site_answer(each, now_ns)) for each in found], mark)

    @router.get("/zones", response_model=Page[ZoneAnswer])
    async def zones(*, site: Name = "", limit: Limit = DEFAULT_LIMIT, after: After = None) -> Response:
        """The objects in each zone of the zone file, by site and name: each once, whichever robot saw it."""
        now_ns, fleet = time.time_ns(), monitor.fleet
        counted = fleet.world.zones(fleet.sites, now_ns)
        every = sorted((each for each in counted if site in ("", each.zone.site)), key=_zone_place)
        found, mark = page_of(every, _zone_place, limit, after, 2)
        return page_response(now_ns, [encoded_answer(zone_answer(each)) for each in found], mark)

    @router.get("/workers", response_model=Page[WorkerAnswer])
    async def workers(*, service: Name = "", limit: Limit = DEFAULT_LIMIT, after: After = None) -> Response:
        """Every worker: the cameras it serves, and its frame counts."""
        found, mark = page_of(
            monitor.workers().lines,
            _worker_place,
            limit,
            after,
            2,
            wanted=lambda each: service in ("", each.status.service),
        )
        items = [encoded_answer(worker_answer(each)) async for each in in_turns(found)]
        return page_response(time.time_ns(), items, mark)

    return router


def _name_place(name: str) -> tuple[str, ...]:
    return (name,)


def _camera_place(key: CameraKey) -> tuple[str, ...]:
    return (key.robot, key.camera)


def _entry_place(entry: Entry) -> tuple[str, ...]:
    return (entry.sighting.key.robot, entry.sighting.key.camera, entry.sighting.name)


def _site_place(known: KnownSite) -> tuple[str, ...]:
    return (known.status.site,)


def _zone_place(counted: ZoneCount) -> tuple[str, ...]:
    return (counted.zone.site, counted.zone.name)


def _worker_place(line: WorkerLine) -> tuple[str, ...]:
    return (line.status.service, line.status.worker)
