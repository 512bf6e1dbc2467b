"""The monitor process: subscribes to everything about the fleet and runs all parts of the monitor."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, nullcontext

from rich.console import Console

from bus import QUEUE, Bus, Sample, Subscription, open_bus
from bus.api import Queue
from bus.clocks import clock_id
from schemas import codec, keys, worker_keys
from schemas.detections import KEPT_LISTS, ClassList
from schemas.distances import Distances
from schemas.errors import SchemaError
from schemas.inventory import WarehouseReport
from schemas.keys import CameraKey, Stream
from schemas.status import GatewayStatus, WorkerStatus
from schemas.world import SiteStatus
from services.model_registry.serving import ModelService, serving_models
from services.monitor.alerting.alerting import Alerting
from services.monitor.display import Problems, show
from services.monitor.event_loop.cooperative_yielding import AT_ONCE, arrivals_in_turns, in_turns
from services.monitor.event_loop.gc_tuning import keep_collections_short
from services.monitor.fleet import Fleet
from services.monitor.health import Health
from services.monitor.history.archive import Archive
from services.monitor.history.settings import NONE
from services.monitor.history.state import HistoryError, OtherVersionError
from services.monitor.history.writer import HistoryWriter
from services.monitor.inventory.member_limit import InventoryFullError
from services.monitor.inventory.sighting import Change
from services.monitor.join_address import how_to_join
from services.monitor.liveness import Heartbeat
from services.monitor.map.floor_plan import load_floor_plan
from services.monitor.monitor import Monitor
from services.monitor.requests.clock_readings import measure_clocks
from services.monitor.requests.inventory_queries import answer_inventory
from services.monitor.robot_clocks import Arrival, ClockHoldback
from services.monitor.rules.rule_file import RuleFile
from services.monitor.settings import MonitorSettings
from services.monitor.warehouses.reporting import report_to_centre
from services.monitor.web.auth.store import UserStore, users_url
from services.monitor.web.process import Web
from services.monitor.world.conditions import WorldConditions
from services.monitor.world.following import follow_world
from services.monitor.world.site_objects import World
from services.monitor.world.zone_file import ZoneFile

log = logging.getLogger(__name__)

WAITING = QUEUE(10_000, 32 << 20, in_turn=True)
"""Messages of each kind that wait."""

LISTS_WAITING = QUEUE(200_000, 64 << 20, in_turn=True)
"""Class lists that wait: those kept by thousands of robots during a cut arrive at once."""

TICK_S = 1.0


OnChanges = Callable[[Sequence[Change]], None]
"""Called with changes of the inventory."""


async def run(settings: MonitorSettings) -> None:
    """Show the fleet, write its history and raise alerts until cancelled.

    Raises:
        RuleFileError: the rule file cannot be used.
        FloorPlanError: the floor plan cannot be used.
        ZoneFileError: the zone file cannot be used.
        OtherVersionError: the database of the history or of the users is another version's.
        WebError: the page's port cannot be had.
        RegistryError: the folder of models cannot be used.
        BusError: the bus refuses its settings.
    """
    if settings.web and settings.history == NONE:
        await _check_users()
    web = Web.of(settings) if settings.web else None
    fleet = Fleet(clock_id(), settings.limits())
    async with (
        open_bus(settings) as bus,
        nullcontext() if settings.models is None else serving_models(bus, settings.models) as models,
        running(settings, bus, fleet, models) as monitor,
        asyncio.TaskGroup() as group,
    ):
        group.create_task(keep_collections_short(lambda: sum(1 for _ in fleet.inventory.cameras())))
        if web is not None:
            group.create_task(web.run(monitor))

        def problems() -> list[str]:
            return [*monitor.problems(), *([] if web is None else web.notes())]

        notes = [how_to_join(settings), *([] if web is None else [f"page: {web.url}"])]
        group.create_task(show(fleet, Console(), settings.refresh_s, note="\n".join(notes), problems=problems))


async def _check_users() -> None:
    """Refuse a database of the users' own that is another version's; one that cannot be had is waited for."""
    try:
        await UserStore(users_url(NONE)).users()
    except OtherVersionError:
        raise
    except HistoryError:
        pass


@asynccontextmanager
async def running(
    settings: MonitorSettings, bus: Bus, fleet: Fleet, models: ModelService | None = None
) -> AsyncIterator[Monitor]:
    """Watch the fleet, write its history and raise alerts within the context. models: see Monitor.

    Raises:
        RuleFileError: the rule file cannot be used.
        FloorPlanError: the floor plan cannot be used.
        ZoneFileError: the zone file cannot be used.
        OtherVersionError: the database of the history is another version's.
    """
    rules = RuleFile(settings.rules)
    await rules.load()
    plan = None if settings.floor_plan is None else await asyncio.to_thread(load_floor_plan, settings.floor_plan)
    fleet.world = World(on=settings.follows_world)
    zones = ZoneFile(settings.zones, fleet.world)
    await zones.load()
    health = Health(bus, hub=not settings.has_one_link, settings=settings)
    heartbeat = Heartbeat(health.heard_s, settings.lease_s)
    conditions = WorldConditions(fleet.world, fleet.sites, fleet.places.poses)
    page = "" if settings.web_url is None else str(settings.web_url).rstrip("/")
    robot_ns = fleet.clocks.robot_ns
    alerting = Alerting(rules, fleet.inventory, heartbeat, conditions=conditions, robot_ns=robot_ns, page=page)
    history = HistoryWriter(
        settings, fleet.inventory, alerting.lead, fleet.places, alerting, world=(fleet.world, fleet.sites)
    )
    monitor = Monitor(settings, bus, fleet, rules, alerting, history, Archive(settings.history), health, plan, zones)
    monitor.models = models

    def told(changes: Sequence[Change]) -> None:
        if changes:
            history.take(changes)
            alerting.take(changes)

    await history.restore()
    async with asyncio.TaskGroup() as group:
        tasks = [
            group.create_task(history.run()),
            group.create_task(alerting.run(bus, keep=history.alert, leads=lambda: history.status.leads)),
            group.create_task(watch_fleet(bus, fleet, told, alerting.measured, monitor.problems)),
            group.create_task(health.run()),
            group.create_task(zones.watch()),
        ]
        if settings.centre:
            tasks.append(group.create_task(report_to_centre(monitor.centre, monitor)))
        try:
            yield monitor
        finally:
            for task in tasks:
                task.cancel()


def _ignore(_: object) -> None:
    pass


async def watch_fleet(
    bus: Bus,
    fleet: Fleet,
    told: OnChanges = _ignore,
    measured: Callable[[CameraKey], None] = _ignore,
    problems: Problems = tuple,
) -> None:
    """Keep `fleet` up to date from the bus, and answer inventory requests, until cancelled.

    measured: is told of each camera whose distances came. problems: what programs are told beside the inventory.
    """
    undated = ClockHoldback(fleet.is_dated)

    def take_list(sample: Sample) -> None:
        arrival = Arrival(_seen(sample), time.monotonic(), sample.received_ns)
        for each in undated.arrive(arrival, kept=sample.kept):
            told(fleet.see(*each) or ())

    streams: dict[str, Callable[[Sample], None]] = {
        keys.every_stream(Stream.OPINION): lambda sample: _opinion(fleet, sample),
        keys.every_stream(Stream.DISTANCES): lambda sample: measured(_distances(fleet, sample)),
        keys.EVERY_GATEWAY_STATUS: lambda sample: _gateway_status(fleet, sample),
        worker_keys.EVERY_WORKER_STATUS: lambda sample: _worker_status(fleet, sample),
        worker_keys.EVERY_WAREHOUSE_REPORT: lambda sample: _warehouse_report(fleet, sample),
    }
    if fleet.world.on:
        streams[worker_keys.EVERY_WORLD_STATUS] = lambda sample: _site_status(fleet, sample)
    cameras = keys.every_stream_alive(Stream.COLOR)
    async with answer_inventory(bus, fleet, problems), asyncio.TaskGroup() as group:
        class_lists = keys.every_stream(Stream.CLASSES)
        group.create_task(
            _receive(
                bus,
                fleet,
                class_lists,
                take_list,
                keep=LISTS_WAITING,
                recover=KEPT_LISTS,
                of="class lists",
            )
        )
        for key_expr, take in streams.items():
            group.create_task(_receive(bus, fleet, key_expr, take))
        group.create_task(
            _watch(bus, fleet, keys.EVERY_ROBOT_ALIVE, lambda key, alive: _robot(fleet, key, alive=alive))
        )
        group.create_task(_watch(bus, fleet, cameras, lambda key, alive: _camera(fleet, key, alive=alive)))
        group.create_task(measure_clocks(bus, fleet))
        group.create_task(follow_world(bus, fleet.world, fleet.sites))
        group.create_task(_tick(fleet, undated, told))


async def _tick(fleet: Fleet, undated: ClockHoldback, told: OnChanges) -> None:
    while True:
        await asyncio.sleep(TICK_S)
        now_ns = time.time_ns()
        async for arrivals in in_turns(undated.due(now_ns)):
            for each in arrivals:
                try:
                    told(fleet.see(*each) or ())
                except InventoryFullError as error:
                    _leave_out(fleet, each.seen.header.robot, error)
        told(fleet.tick(now_ns))


async def _receive(
    bus: Bus,
    fleet: Fleet,
    key_expr: str,
    take: Callable[[Sample], None],
    *,
    keep: Queue = WAITING,
    recover: int = 1,
    of: str = "messages",
) -> None:
    async with (
        bus.subscribe(key_expr, keep, recover=recover) as subscription,
        asyncio.TaskGroup() as group,
    ):
        counting = group.create_task(_count_missed(fleet, subscription, of))
        async for batch in subscription.batches(AT_ONCE):
            async for sample in in_turns(batch):
                if sample.replaced:
                    fleet.left_out["messages that came too fast"] += sample.replaced
                try:
                    take(sample)
                except (SchemaError, InventoryFullError) as error:
                    _leave_out(fleet, sample.key, error)
            await asyncio.sleep(0)  # lets other tasks run while more messages wait
        counting.cancel()


async def _count_missed(fleet: Fleet, subscription: Subscription, of: str) -> None:
    counted = 0
    while True:
        await asyncio.sleep(TICK_S)
        missed = subscription.counts.missed
        if missed > counted:
            fleet.left_out[f"{of} lost on the way"] += missed - counted
        counted = missed


async def _watch(bus: Bus, fleet: Fleet, key_expr: str, take: Callable[[str, bool], None]) -> None:
    async with bus.watch(key_expr) as watch:
        async for presence in arrivals_in_turns(watch):
            try:
                take(presence.key, presence.alive)
            except (SchemaError, InventoryFullError) as error:
                _leave_out(fleet, presence.key, error)


def _leave_out(fleet: Fleet, key: str, error: SchemaError | InventoryFullError) -> None:
    """Count a rejected message: one bad message harms no other, and a flood of them does not fill the log."""
    malformed = isinstance(error, SchemaError)
    reason = "malformed messages" if malformed else "messages of robots and cameras over the limit"
    fleet.left_out[reason] += 1
    if fleet.left_out[reason].bit_count() == 1:
        log.warning("%s: left out: %s (%d %s so far)", key, error, fleet.left_out[reason], reason)


def _opinion(fleet: Fleet, sample: Sample) -> None:
    fleet.opine(_seen(sample), sample.received_ns)


def _seen(sample: Sample) -> ClassList:
    seen = codec.decode(ClassList, sample.payload, sample.encoding)
    codec.check_identity(seen.header, keys.parse_stream(sample.key).camera)
    return seen


def _distances(fleet: Fleet, sample: Sample) -> CameraKey:
    distances = codec.decode(Distances, sample.payload, sample.encoding)
    key = keys.parse_stream(sample.key).camera
    codec.check_identity(distances.header, key)
    fleet.measure(distances, sample.received_ns)
    return key


def _gateway_status(fleet: Fleet, sample: Sample) -> None:
    status = codec.decode(GatewayStatus, sample.payload, sample.encoding)
    if status.robot != keys.parse_robot(sample.key):
        raise SchemaError(f"status of {status.robot}")
    fleet.gateway_status(status, sample.received_ns, len(sample.payload))


def _worker_status(fleet: Fleet, sample: Sample) -> None:
    status = codec.decode(WorkerStatus, sample.payload, sample.encoding)
    if (status.service, status.worker) != worker_keys.parse_worker(sample.key):
        raise SchemaError(f"status of {status.service}/{status.worker}")
    fleet.worker_status(status, sample.received_ns, len(sample.payload))


def _site_status(fleet: Fleet, sample: Sample) -> None:
    status = codec.decode(SiteStatus, sample.payload, sample.encoding)
    if status.site != worker_keys.parse_world(sample.key)[0]:
        raise SchemaError(f"status of site {status.site}")
    fleet.sites.take(status, sample.received_ns, len(sample.payload))
    fleet.world.hear(status)


def _warehouse_report(fleet: Fleet, sample: Sample) -> None:
    report = codec.decode(WarehouseReport, sample.payload, sample.encoding)
    if report.warehouse != worker_keys.parse_warehouse_report(sample.key):
        raise SchemaError(f"report of warehouse {report.warehouse}")
    fleet.warehouses.take(report, sample.received_ns, len(sample.payload))


def _robot(fleet: Fleet, key: str, *, alive: bool) -> None:
    fleet.robot_presence(keys.parse_robot(key), alive=alive)


def _camera(fleet: Fleet, key: str, *, alive: bool) -> None:
    fleet.camera_presence(keys.parse_stream(key).camera, alive=alive)
