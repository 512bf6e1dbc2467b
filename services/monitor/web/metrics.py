"""Prometheus metrics, computed on request, so that they cost nothing otherwise."""

import asyncio
import time
from collections import Counter
from collections.abc import Iterator
from typing import Final

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from schemas.alerts import Severity
from schemas.keys import CameraKey, Stream
from schemas.status import BEYOND_USE, GatewayStatus
from schemas.worker_keys import DETECTOR
from services.monitor.inventory.member_limit import MAX_MEMBERS
from services.monitor.monitor import Monitor
from services.monitor.snapshot import CameraLine, RobotLine, Snapshot, WorkerLine
from services.monitor.web.auth.gate import HEALTH, METRICS
from services.monitor.web.auth.logins import Access
from services.monitor.web.auth.users import STATE

MAX_LABELLED: Final = 5_000
"""Robots, and cameras, that have series of their own; the first by name."""

MAX_REASONS: Final = 32
"""Reasons for drops that a robot, or a worker, has series for; the first by name."""

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"


async def metrics_of(monitor: Monitor) -> bytes:
    """Return all metrics in Prometheus's text format."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_MonitorCollector(monitor, await monitor.snapshot()))
    return await asyncio.to_thread(generate_latest, registry)


class _MonitorCollector(Collector):
    """The metrics of one moment, collected before they are written, as values change meanwhile."""

    def __init__(self, monitor: Monitor, snapshot: Snapshot) -> None:
        self._monitor = list(_of_monitor(monitor, snapshot))
        self._snapshot = snapshot
        self._refused = Counter(monitor.fleet.inventory.refused)

    def collect(self) -> Iterator[Metric]:
        """Yield the metrics."""
        yield from self._monitor
        yield from _of_robots(self._snapshot.robots[:MAX_LABELLED])
        yield from _of_cameras(self._snapshot.cameras[:MAX_LABELLED], self._refused)
        yield from _of_workers(self._snapshot.workers[:MAX_LABELLED])
        yield _beyond_use(self._snapshot)


def _of_monitor(monitor: Monitor, snapshot: Snapshot) -> Iterator[Metric]:
    history = monitor.history.status
    yield GaugeMetricFamily("fleetsight_robots", "Robots ever heard of and not forgotten.", len(snapshot.robots))
    yield GaugeMetricFamily("fleetsight_robots_online", "Robots online.", sum(each.online for each in snapshot.robots))
    yield GaugeMetricFamily("fleetsight_cameras", "Cameras of these robots.", len(snapshot.cameras))
    limit = monitor.fleet.inventory.member_limit
    yield GaugeMetricFamily("fleetsight_cameras_limit", "Maximum number of cameras followed.", MAX_MEMBERS)
    yield CounterMetricFamily(
        "fleetsight_cameras_made_room", "Absent cameras forgotten, as there were more names than the limit.", limit.made
    )
    yield GaugeMetricFamily(
        "fleetsight_unlabelled", "Robots, cameras and workers over the limit, without series.", _over(snapshot)
    )
    yield GaugeMetricFamily("fleetsight_mesh_up", "1 while the monitor can hear the fleet.", not monitor.health.problem)
    yield GaugeMetricFamily("fleetsight_links", "Zenoh links to the monitor.", monitor.bus.links.count)
    yield GaugeMetricFamily("fleetsight_links_limit", "Maximum number of Zenoh links.", monitor.bus.links.limit)
    doubted = GaugeMetricFamily(
        "fleetsight_doubted_names",
        "Names that several speak under, or that access rules allow nothing.",
        labels=["why"],
    )
    doubted.add_metric(["certificate at several addresses"], monitor.bus.links.copied)
    doubted.add_metric(["certificate in no access rule"], monitor.bus.links.strangers)
    doubted.add_metric(["robot with several gateways"], len(monitor.fleet.duplicates.robots()))
    doubted.add_metric(["camera with several senders"], len(monitor.fleet.rivals.found(snapshot.now_ns)))
    yield doubted
    yield GaugeMetricFamily("fleetsight_history_kept", "1 while the history is kept.", not history.problem)
    yield GaugeMetricFamily("fleetsight_history_pending", "History rows waiting for the database.", history.pending)
    yield CounterMetricFamily(
        "fleetsight_class_lists", "Class lists received, without duplicates.", monitor.fleet.class_lists
    )
    yield CounterMetricFamily(
        "fleetsight_class_lists_refused",
        "Class lists that were duplicate, late or out of order.",
        monitor.fleet.refused_lists,
    )
    yield CounterMetricFamily(
        "fleetsight_opinions_ignored",
        "Second opinions that were duplicate, late, or of cameras that are not known.",
        monitor.fleet.inventory.ignored_opinions,
    )
    yield CounterMetricFamily(
        "fleetsight_distances_ignored",
        "Distances that were duplicate, late or out of order.",
        monitor.fleet.inventory.ignored_distances,
    )
    yield CounterMetricFamily("fleetsight_history_lost", "History intervals dropped.", history.lost)
    yield GaugeMetricFamily("fleetsight_leads", "1 while this monitor raises the alerts.", history.leads)
    yield GaugeMetricFamily("fleetsight_rules", "Rules in force.", len(monitor.rules.book.rules))
    yield GaugeMetricFamily("fleetsight_rules_ok", "1 while the rule file is in force.", not monitor.rules.problem)
    yield from _of_sites(monitor)
    yield from _of_warehouses(monitor)
    left_out = CounterMetricFamily("fleetsight_messages_left_out", "Messages left out.", labels=["reason"])
    for reason, count in sorted(monitor.fleet.left_out.items())[:MAX_REASONS]:
        left_out.add_metric([reason], count)
    yield left_out
    alerts = GaugeMetricFamily(
        "fleetsight_alerts", "Alerts of this monitor that are not resolved.", labels=["severity"]
    )
    current = monitor.alerts()
    for severity in Severity:
        alerts.add_metric([severity], sum(alert.severity == severity for alert in current))
    yield alerts
    posts = CounterMetricFamily(
        "fleetsight_webhook_alerts", "Alerts for webhooks, by outcome.", labels=["webhook", "outcome"]
    )
    for (webhook, outcome), count in sorted(monitor.alerting.posts().items()):
        posts.add_metric([webhook, outcome], count)
    yield posts


def _of_sites(monitor: Monitor) -> Iterator[Metric]:
    objects = GaugeMetricFamily("fleetsight_site_objects", "Objects in a site, each once.", labels=["site", "class"])
    doubted = GaugeMetricFamily(
        "fleetsight_site_doubted_robots", "Robots whose sightings are left out for now.", labels=["site"]
    )
    zones = GaugeMetricFamily(
        "fleetsight_zone_objects", "Objects in a zone of a site, each once.", labels=["site", "zone", "class"]
    )
    now_ns = time.time_ns()
    for counted in monitor.fleet.world.zones(monitor.fleet.sites, now_ns):
        if counted.current:
            for name, count in sorted(counted.objects.items())[:MAX_REASONS]:
                zones.add_metric([counted.zone.site, counted.zone.name, name], count)
    for status in monitor.fleet.sites.current(now_ns):
        doubted.add_metric([status.site], sum(bool(robot.doubted) for robot in status.robots))
        for name, count in sorted(status.objects.items())[:MAX_REASONS]:
            objects.add_metric([status.site, name], count)
    yield from (objects, doubted, zones)


def _of_warehouses(monitor: Monitor) -> Iterator[Metric]:
    """Yield what the warehouses under this centre report; nothing where none does."""
    name, now_ns = ["warehouse"], time.time_ns()
    up = GaugeMetricFamily("fleetsight_warehouse_up", "1 while the warehouse reports.", labels=name)
    robots = GaugeMetricFamily("fleetsight_warehouse_robots", "Robots known there.", labels=name)
    online = GaugeMetricFamily("fleetsight_warehouse_robots_online", "Robots online there.", labels=name)
    objects = GaugeMetricFamily("fleetsight_warehouse_objects", "Objects there, each once.", labels=[*name, "class"])
    alerts = GaugeMetricFamily("fleetsight_warehouse_alerts", "Open alerts there.", labels=[*name, "severity"])
    for known in monitor.fleet.warehouses.every():
        up.add_metric([known.name], known.is_current(now_ns))
        if known.is_current(now_ns):
            robots.add_metric([known.name], known.report.robots)
            online.add_metric([known.name], known.report.robots_online)
            for of, count in sorted(known.objects.items())[:MAX_REASONS]:
                objects.add_metric([known.name, of], count)
            for severity in Severity:
                alerts.add_metric([known.name, severity], known.report.alerts.get(severity, 0))
    yield from (up, robots, online, objects, alerts)


def _of_robots(robots: tuple[RobotLine, ...]) -> Iterator[Metric]:
    online = GaugeMetricFamily("fleetsight_robot_online", "1 while the robot's gateway is online.", labels=["robot"])
    info = GaugeMetricFamily("fleetsight_gateway_info", "1, and the gateway's version.", labels=["robot", "version"])
    last = GaugeMetricFamily(
        "fleetsight_robot_last_seen_seconds", "Time of the robot's last message, epoch; 0 for never.", labels=["robot"]
    )
    dropped = CounterMetricFamily(
        "fleetsight_robot_frames_dropped", "Frames dropped, by place and reason.", labels=["robot", "reason"]
    )
    for robot in robots:
        online.add_metric([robot.name], robot.online)
        last.add_metric([robot.name], robot.last_ns / 1e9)
        if robot.gateway is not None:
            info.add_metric([robot.name, robot.gateway.version], 1)
        for reason, count in sorted(robot.dropped.items())[:MAX_REASONS]:
            dropped.add_metric([robot.name, reason], count)
    yield from (online, info, last, dropped)


def _of_cameras(cameras: tuple[CameraLine, ...], refused: Counter[CameraKey]) -> Iterator[Metric]:
    names = ["robot", "camera"]
    online = GaugeMetricFamily("fleetsight_camera_online", "1 while the camera is online.", labels=names)
    rate = GaugeMetricFamily("fleetsight_camera_class_lists_hz", "Class lists per second.", labels=names)
    age = GaugeMetricFamily("fleetsight_camera_age_seconds", "Age of the newest frame.", labels=names)
    late = CounterMetricFamily(
        "fleetsight_camera_class_lists_refused", "Class lists that were duplicate, late or out of order.", labels=names
    )
    for camera in cameras:
        labels = [camera.key.robot, camera.key.camera]
        if camera.key in refused:
            late.add_metric(labels, refused[camera.key])
        online.add_metric(labels, camera.row.online)
        rate.add_metric(labels, camera.row.rate_hz)
        if camera.row.age is not None:
            age.add_metric(labels, camera.row.age.seconds)
    yield from (online, rate, age, late)


def _of_workers(workers: tuple[WorkerLine, ...]) -> Iterator[Metric]:
    names = ["service", "worker"]
    online = GaugeMetricFamily("fleetsight_worker_online", "1 while the worker reports.", labels=names)
    info = GaugeMetricFamily("fleetsight_worker_info", "1, and the worker's version.", labels=[*names, "version"])
    serves = GaugeMetricFamily("fleetsight_worker_cameras", "Cameras that the worker serves.", labels=names)
    busy = CounterMetricFamily("fleetsight_worker_busy_seconds", "Seconds of work on frames.", labels=names)
    inferred = CounterMetricFamily("fleetsight_worker_frames_inferred", "Frames processed.", labels=names)
    dropped = CounterMetricFamily(
        "fleetsight_worker_frames_dropped", "Frames dropped, by reason.", labels=[*names, "reason"]
    )
    for worker in workers:
        labels = [worker.status.service, worker.status.worker]
        online.add_metric(labels, worker.online)
        info.add_metric([*labels, worker.status.version], 1)
        serves.add_metric(labels, len(worker.serves))
        if worker.status.busy_s is not None:
            busy.add_metric(labels, worker.status.busy_s)
        inferred.add_metric(labels, sum(load.inferred for load in worker.status.cameras))
        reasons = Counter[str]()
        for load in worker.status.cameras:
            reasons.update(load.dropped)
        for reason, count in sorted(reasons.items())[:MAX_REASONS]:
            dropped.add_metric([*labels, reason], count)
    yield from (online, info, serves, busy, inferred, dropped)


def _beyond_use(snapshot: Snapshot) -> Metric:
    """Count the frames that gateways left out because detectors asked for fewer.

    A camera has a series while a detector limits its rate. Frames left out because only a second opinion wants the
    camera, which asks for few frames however much time it has, are no demand.
    """
    names = ["robot", "camera"]
    left_out = CounterMetricFamily(
        "fleetsight_camera_frames_beyond_use", "Frames left out because detectors asked for fewer.", labels=names
    )
    gateways = {robot.name: robot.gateway for robot in snapshot.robots}
    limited = sorted(
        {
            (load.robot, load.camera)
            for worker in snapshot.workers
            if worker.status.service == DETECTOR
            for load in worker.serves
            if load.budget_hz is not None
        }
    )
    for robot, camera in limited[:MAX_LABELLED]:
        left_out.add_metric([robot, camera], _left_out(gateways.get(robot), camera))
    return left_out


def _left_out(gateway: GatewayStatus | None, camera: str) -> int:
    streams = () if gateway is None else gateway.streams
    return sum(
        stream.dropped.get(BEYOND_USE, 0)
        for stream in streams
        if stream.camera == camera and stream.stream == Stream.COLOR
    )


def _over(snapshot: Snapshot) -> int:
    return sum(max(0, len(each) - MAX_LABELLED) for each in (snapshot.robots, snapshot.cameras, snapshot.workers))


def watching_routes(monitor: Monitor, access: Access) -> APIRouter:
    """Return the routes."""
    router = APIRouter(include_in_schema=False)

    @router.get(HEALTH)
    async def health(request: Request) -> Response:
        """503 while the fleet cannot be heard; only logged-in users get the reason. All are told if links are open."""
        dead, not_kept = monitor.health.problem, monitor.history.status.problem
        degraded = {
            "the history is not being kept": not_kept,
            "log-ins": access.problem,
            "rules": monitor.rules.problem,
        }
        told = {what: why for what, why in degraded.items() if why}
        answer: dict[str, object] = {"status": "dead" if dead else "degraded" if told else "ok"}
        visitor = request.scope[STATE]
        may_look = visitor is not None and visitor.may_look
        if may_look or dead or told:
            answer |= {"reason": dead and (dead if may_look else "the fleet cannot be heard"), "degraded": sorted(told)}
        if may_look:
            answer["details"] = told
        if monitor.open_to_all:
            answer["insecure"] = monitor.open_to_all
        return JSONResponse(answer, 503 if dead else 200)

    @router.get(METRICS)
    async def metrics() -> Response:
        return Response(await metrics_of(monitor), media_type=CONTENT_TYPE)

    return router
