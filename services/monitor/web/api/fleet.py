"""Routes about the fleet now: robots, cameras, what is in view, gateways, workers."""

from fastapi import APIRouter

from services.monitor.inventory.inventory import Entry
from services.monitor.monitor import Monitor
from services.monitor.picture import CameraLine, RobotLine, WorkerLine
from services.monitor.web.api.models import (
    CameraAnswer,
    GatewayAnswer,
    Page,
    RobotAnswer,
    SightingAnswer,
    WorkerAnswer,
    camera_answer,
    gateway_answer,
    moment,
    robot_answer,
    sighting_answer,
    worker_answer,
)
from services.monitor.web.api.paging import After, ClassName, Limit, Name, page_of

DEFAULT_LIMIT = 200


def fleet_routes(monitor: Monitor) -> APIRouter:
    """Return the routes."""
    router = APIRouter(tags=["fleet"])

    @router.get("/robots")
    async def robots(
        *, online: bool | None = None, limit: Limit = DEFAULT_LIMIT, after: After = None
    ) -> Page[RobotAnswer]:
        """Every robot that was ever heard of, by name; one that is gone stays."""
        picture = await monitor.picture()
        found = (each for each in picture.robots if online in (None, each.online))
        items, mark = page_of(found, _robot_place, limit, after, 1)
        return Page(now=moment(picture.now_ns), items=[robot_answer(each) for each in items], next=mark)

    @router.get("/cameras")
    async def cameras(
        *, robot: Name = "", online: bool | None = None, limit: Limit = DEFAULT_LIMIT, after: After = None
    ) -> Page[CameraAnswer]:
        """Every camera, by robot and name."""
        picture = await monitor.picture()
        found = (
            each for each in picture.cameras if robot in ("", each.key.robot) and online in (None, each.row.online)
        )
        items, mark = page_of(found, _camera_place, limit, after, 2)
        return Page(now=moment(picture.now_ns), items=[camera_answer(each) for each in items], next=mark)

    @router.get("/inventory")
    async def inventory(
        *,
        robot: Name = "",
        camera: Name = "",
        name: ClassName = "",
        in_view: bool = False,
        available: bool | None = None,
        limit: Limit = DEFAULT_LIMIT,
        after: After = None,
    ) -> Page[SightingAnswer]:
        """What is or was in view, by robot, camera and class, settled from lists that flicker."""
        entries, now_ns = await monitor.inventory(), (await monitor.picture()).now_ns
        found = (
            each
            for each in entries
            if robot in ("", each.sighting.key.robot)
            and camera in ("", each.sighting.key.camera)
            and name in ("", each.sighting.name)
            and (each.sighting.count or not in_view)
            and available in (None, each.available)
        )
        items, mark = page_of(found, _entry_place, limit, after, 3)
        return Page(now=moment(now_ns), items=[sighting_answer(each) for each in items], next=mark)

    @router.get("/gateways")
    async def gateways(*, robot: Name = "", limit: Limit = DEFAULT_LIMIT, after: After = None) -> Page[GatewayAnswer]:
        """What each robot's gateway says of itself: every stream, its rates and drops."""
        picture = await monitor.picture()
        found = (each for each in picture.robots if each.gateway is not None and robot in ("", each.name))
        items, mark = page_of(found, _robot_place, limit, after, 1)
        answers = [answer for each in items if (answer := gateway_answer(each)) is not None]
        return Page(now=moment(picture.now_ns), items=answers, next=mark)

    @router.get("/workers")
    async def workers(*, service: Name = "", limit: Limit = DEFAULT_LIMIT, after: After = None) -> Page[WorkerAnswer]:
        """Every worker: which cameras it looks after, and what became of their frames."""
        picture = await monitor.picture()
        found = (each for each in picture.workers if service in ("", each.status.service))
        items, mark = page_of(found, _worker_place, limit, after, 2)
        return Page(now=moment(picture.now_ns), items=[worker_answer(each) for each in items], next=mark)

    return router


def _robot_place(line: RobotLine) -> tuple[str, ...]:
    return (line.name,)


def _camera_place(line: CameraLine) -> tuple[str, ...]:
    return (line.key.robot, line.key.camera)


def _entry_place(entry: Entry) -> tuple[str, ...]:
    return (entry.sighting.key.robot, entry.sighting.key.camera, entry.sighting.name)


def _worker_place(line: WorkerLine) -> tuple[str, ...]:
    return (line.status.service, line.status.worker)
