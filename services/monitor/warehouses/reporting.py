"""Reports this warehouse to a centre: totals, alerts and problems, and its objects on request; nothing else leaves.

The centre is reached by a session of its own, so that no stream, class list or presence of the fleet is ever declared
there, whatever the centre subscribes to.
"""

import asyncio
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from itertools import islice
from typing import Final

from bus import Bus, BusError, QoS, RefusedError, Reply, Request, RequestError, open_bus
from bus.reporting import VERSION
from schemas import codec, worker_keys
from schemas.alerts import Alert, Severity
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL
from schemas.inventory import (
    MAX_CLASSES,
    MAX_PROBLEMS,
    MAX_REPORTED_ALERTS,
    MAX_REPORTED_SITES,
    SiteTotals,
    WarehouseReport,
)
from schemas.worker_keys import WorldStream
from schemas.world import WorldRequest
from services.monitor.formats import limited
from services.monitor.history.state import HistoryError
from services.monitor.monitor import Monitor
from services.monitor.warehouses.centre_link import CentreLink
from services.monitor.world.site_objects import SITE

EVERY_S: Final = 2.0
TIMEOUT_S: Final = 10.0
AT_ONCE: Final = 2
WAITING: Final = 16
SEVEREST_FIRST: Final = {severity: -place for place, severity in enumerate(Severity)}


async def report_to_centre(link: CentreLink, monitor: Monitor) -> None:
    """Report until cancelled; of two monitors with one history only the one that raises the alerts has a link.

    Errors of the link or of a report are shown as its problem, and the report is tried again.
    """
    while True:
        if monitor.history.status.leads:
            try:
                async with open_bus(monitor.settings.centre_bus()) as bus:
                    with link.using(bus):
                        await _report_while_leading(bus, link, monitor)
            except BusError as error:
                link.refuse(str(error))
        await asyncio.sleep(EVERY_S)


async def _report_while_leading(bus: Bus, link: CentreLink, monitor: Monitor) -> None:
    name = monitor.settings.warehouse
    key, objects = worker_keys.warehouse_report(name), worker_keys.every_warehouse_objects(name)

    async def answer(request: Request) -> Reply:
        return await _objects(monitor, request)

    async with (
        bus.publisher(key, QoS.STATUS, encoding=codec.encoding(WarehouseReport)) as publisher,
        bus.serve(objects, answer, at_once=AT_ONCE, waiting=WAITING),
    ):
        while monitor.history.status.leads:
            try:
                payload = codec.encode(await report_of(monitor))
            except Exception as error:  # noqa: BLE001 - the warehouse goes on without its centre
                link.refuse(f"no report can be made: {error}")
            else:
                link.refuse("")
                publisher.put(payload)
            await asyncio.sleep(EVERY_S)


async def report_of(monitor: Monitor) -> WarehouseReport:
    """Return the current report of this monitor's warehouse."""
    fleet, settings, now_ns = monitor.fleet, monitor.settings, time.time_ns()
    view = monitor.fleet_view()
    in_view = Counter[str]()
    for entry in await monitor.inventory():
        if entry.available and entry.sighting.count:
            in_view[entry.sighting.name] += entry.sighting.count
    sites = [
        SiteTotals(
            site=name,
            current=not site.is_behind and fleet.sites.is_current(name, now_ns),
            objects=_most(site.count(SITE)),
        )
        for name, site in islice(sorted(fleet.world.sites.items()), MAX_REPORTED_SITES)
    ]
    alerts: Sequence[Alert] = ()
    with suppress(HistoryError):  # said among the problems
        alerts = await monitor.current_alerts()
    return WarehouseReport(
        warehouse=settings.warehouse,
        version=VERSION,
        sent_ns=now_ns,
        page="" if settings.web_url is None else str(settings.web_url).rstrip("/"),
        robots=len(view.robots),
        robots_online=sum(map(fleet.inventory.is_alive, view.robots)),
        cameras=len(view.cameras),
        cameras_online=sum(map(fleet.inventory.online, view.cameras)),
        workers=sum(line.online for line in view.workers.lines),
        in_view=_most(in_view),
        sites=sites,
        alerts=dict(Counter(str(alert.severity) for alert in alerts)),
        open=sorted(alerts, key=lambda each: (SEVEREST_FIRST[Severity(each.severity)], -each.raised_ns))[
            :MAX_REPORTED_ALERTS
        ],
        problems=[problem[:MAX_LABEL] for problem in limited(monitor.problems(), MAX_PROBLEMS - 1)],
    )


def _most(counts: Counter[str]) -> dict[str, int]:
    return dict(sorted((name, count) for name, count in counts.most_common(MAX_CLASSES) if count))


async def _objects(monitor: Monitor, request: Request) -> Reply:
    """Answer for the objects of a site as its world model does, which is asked."""
    _, site = worker_keys.parse_warehouse_objects(request.key)
    if site not in monitor.fleet.world.sites:
        raise RefusedError(f"there is no site {site}")
    try:
        if request.payload:
            codec.decode(WorldRequest, request.payload, request.encoding)
        key = worker_keys.world_key(site, WorldStream.OBJECTS)
        return await monitor.bus.request(key, request.payload, encoding=request.encoding, timeout_s=TIMEOUT_S)
    except (SchemaError, RequestError) as error:
        raise RefusedError(f"site {site}: {error}") from error
