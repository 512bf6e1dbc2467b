"""The items of live data: the name of each, what makes it news, and its JSON, made only where it is new. Pure."""

from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import Literal

from schemas.alerts import Alert
from schemas.status import GatewayStatus
from services.monitor.fleet import Fleet
from services.monitor.history.state import Act
from services.monitor.inventory.inventory import Entry
from services.monitor.snapshot import CameraLine, RobotLine, Snapshot, WorkerLine
from services.monitor.warehouses.reports import KnownWarehouse
from services.monitor.web.api.bodies import (
    alert_answer,
    camera_body,
    encoded,
    gateway_answer,
    robot_body,
    sighting_body,
    site_answer,
    worker_answer,
    zone_answer,
)
from services.monitor.web.api.objects import FoundObject, object_answer
from services.monitor.web.api.warehouses import warehouse_answer
from services.monitor.world.site_status import KnownSite
from services.monitor.world.zones import ZoneCount

Name = tuple[str, ...]

Found = tuple[Name, Hashable, str, Callable[[], str]]
"""The parts of an item: name, state, robot, and a function that makes its JSON."""


def of_snapshot(topic: Literal["robots", "cameras", "gateways"], snapshot: Snapshot) -> Iterable[Found]:
    """Return the items of a topic that a snapshot has."""
    match topic:
        case "robots":
            return map(_of_robot, snapshot.robots)
        case "cameras":
            return map(_of_camera, snapshot.cameras)
        case "gateways":
            return (_of_gateway(each, each.gateway) for each in snapshot.robots if each.gateway is not None)


def of_world(topic: Literal["sites", "zones", "objects", "warehouses"], fleet: Fleet, now_ns: int) -> Iterable[Found]:
    """Return the items of a topic about sites or warehouses."""
    match topic:
        case "sites":
            return (_of_site(each, now_ns) for each in fleet.sites.every())
        case "zones":
            return map(_of_zone, list(fleet.world.zones(fleet.sites, now_ns)))
        case "warehouses":
            return (_of_warehouse(each, now_ns) for each in fleet.warehouses.every())
        case "objects":
            return (
                _of_object(FoundObject(name, each, current))
                for name, site in list(fleet.world.sites.items())
                for current in [not site.is_behind and fleet.sites.is_current(name, now_ns)]
                for each in list(site.objects.values())
            )


def of_alert(alert: Alert, acts: tuple[Act, ...], known_until_ns: int | None) -> Found:
    """Return the item of an alert. acts: people's, on it. known_until_ns: see `alert_answer`."""
    state = (alert, acts, known_until_ns)
    return (
        (alert.id,),
        state,
        alert.robot,
        lambda: alert_answer(alert, acts, known_until_ns).model_dump_json(by_alias=True),
    )


def _of_robot(robot: RobotLine) -> Found:
    state = (robot.online, robot.problems, robot.cameras, _counts(robot.dropped))
    return (robot.name,), state, robot.name, lambda: encoded(robot_body(robot)).decode()


def _of_camera(camera: CameraLine) -> Found:
    row, key = camera.row, camera.key
    seen = None if row.classes is None else tuple((each.name, each.count) for each in row.classes)
    state = (row.online, row.stale, seen, camera.served_by, _counts(camera.dropped))
    return (key.robot, key.camera), state, key.robot, lambda: encoded(camera_body(camera)).decode()


def of_entry(entry: Entry) -> Found:
    """Return the item of a sighting."""
    of = entry.sighting
    near = None if of.nearest_m is None else round(of.nearest_m, 1)
    state = (of.count, of.first_ns, entry.available, near, of.model)
    return (of.key.robot, of.key.camera, of.name), state, of.key.robot, lambda: encoded(sighting_body(entry)).decode()


def of_worker(worker: WorkerLine) -> Found:
    """Return the item of a worker."""
    status = worker.status
    loads = tuple((load.robot, load.camera, load.serving) for load in status.cameras)
    state = (worker.online, status.model, loads, tuple(status.remarks), status.version, status.runtime)
    name = (status.service, status.worker)
    return name, state, "", lambda: worker_answer(worker).model_dump_json(by_alias=True)


def _of_gateway(robot: RobotLine, of: GatewayStatus) -> Found:
    streams = tuple((each.name, each.topic, each.wanted, each.publishers, each.problem) for each in of.streams)
    returns = tuple((each.camera, each.stream, each.wanted) for each in of.returns)
    state = (robot.online, of.waiting_for, of.clock_jumps, streams, returns, of.version)
    return (
        (of.robot,),
        state,
        of.robot,
        lambda: gateway_answer(of, robot.last_ns, online=robot.online).model_dump_json(by_alias=True),
    )


def _of_site(known: KnownSite, now_ns: int) -> Found:
    of = known.status
    doubted = tuple((robot.robot, robot.doubted) for robot in of.robots)
    state = (known.is_current(now_ns), of.worker, _counts(of.objects), tuple(of.problems), doubted)
    return (of.site,), state, "", lambda: site_answer(known, now_ns).model_dump_json(by_alias=True)


def _of_zone(counted: ZoneCount) -> Found:
    name = (counted.zone.site, counted.zone.name)
    state = (counted.current, _counts(counted.objects))
    return name, state, "", lambda: zone_answer(counted).model_dump_json(by_alias=True)


def _of_object(found: FoundObject) -> Found:
    of = found.placed.of
    place = tuple(round(each, 2) for each in of.at)
    state = (found.current, of.name, place, found.placed.zones, of.looked_ns)
    return (found.site, of.id), state, "", lambda: object_answer(found).model_dump_json(by_alias=True)


def _of_warehouse(known: KnownWarehouse, now_ns: int) -> Found:
    of = known.report
    counts = (of.robots, of.robots_online, of.cameras, of.cameras_online, of.workers)
    alerts = tuple((alert.id, alert.state) for alert in of.open)
    state = (known.is_current(now_ns), counts, _counts(known.objects), _counts(of.alerts), alerts, tuple(of.problems))
    return (known.name,), state, "", lambda: warehouse_answer(known, now_ns).model_dump_json(by_alias=True)


def _counts(dropped: Mapping[str, int]) -> Hashable:
    return tuple(sorted(dropped.items()))
