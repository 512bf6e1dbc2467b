"""A monitor in memory, served as a real one is: for tests of the server, the API and the page."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Any

import httpx
from nicegui import app as nicegui_app

from bus import Bus
from services.monitor.alerting.alerting import Alerting
from services.monitor.alerting.rule_file import RuleFile
from services.monitor.fleet import Fleet
from services.monitor.history.archive import Archive
from services.monitor.history.keeper import HistoryKeeper
from services.monitor.monitor import Monitor
from services.monitor.settings import MonitorSettings
from services.monitor.web.auth.visitor import Role
from services.monitor.web.door import open_door, url_of
from services.monitor.web.server import serve


@dataclass(frozen=True)
class Served:
    """Where a monitor is served. cookie: name and value of what a browser has in which somebody is logged in."""

    url: str
    cookie: tuple[str, str]


def monitor_on(bus: Bus, **given: Any) -> Monitor:
    """Return a monitor without history, unless `given` settings say otherwise; nothing of it runs."""
    settings = MonitorSettings(**{"history": "none", "web_port": 0, **given})
    fleet = Fleet("clock")
    rules = RuleFile(settings.rules)
    alerting = Alerting(rules, fleet.inventory, settle_s=0)
    history = HistoryKeeper(settings, fleet.inventory, alerting.lead)
    return Monitor(settings, bus, fleet, rules, alerting, history, Archive(settings.history))


@asynccontextmanager
async def served(monitor: Monitor, role: Role = Role.OPERATOR) -> AsyncIterator[Served]:
    """Serve page and API on a free port; a user of the role is logged in."""
    nicegui_app.middleware_stack = None  # the page's application outlives each server of this process
    nicegui_app.user_middleware.clear()
    door = open_door(monitor.settings)
    url = url_of(door, monitor.settings)
    serving = asyncio.create_task(serve(monitor, door))
    try:
        async with asyncio.timeout(20), httpx.AsyncClient() as client:
            await client.get(f"{url}/healthz")
        yield Served(url, ("fleetsight", role))
    finally:
        serving.cancel()
        with suppress(asyncio.CancelledError):
            await serving
