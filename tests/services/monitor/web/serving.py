"""A monitor in memory, served as a real one is: for tests of the server, the API and the page."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import httpx
from nicegui import app as nicegui_app

from bus import Bus
from services.monitor.alerting.alerting import Alerting
from services.monitor.fleet import Fleet
from services.monitor.health import Health
from services.monitor.history.archive import Archive
from services.monitor.history.writer import HistoryWriter
from services.monitor.map.floor_plan import FloorPlan
from services.monitor.monitor import Monitor
from services.monitor.rules.rule_file import RuleFile
from services.monitor.settings import MonitorSettings
from services.monitor.web.application import cookie_of
from services.monitor.web.auth.logins import Access
from services.monitor.web.auth.passwords import Passwords
from services.monitor.web.auth.store import UserStore
from services.monitor.web.auth.users import Kind, Login, Role, User, digest_of, new_secret
from services.monitor.web.process import open_listener, url_of
from services.monitor.web.server import serve
from services.monitor.world.site_objects import World
from services.monitor.world.zone_file import ZoneFile
from tests.services.monitor.alerting.hearing import hears

PASSWORD: Final = "correct horse battery"  # noqa: S105 - nobody's


@dataclass(frozen=True)
class Served:
    """Where a monitor is served.

    cookie: name and value of what a browser has in which somebody is logged in. token: of the same user.
    access, users: who may log in, and the database that says so.
    """

    url: str
    cookie: tuple[str, str]
    token: str
    access: Access
    users: UserStore

    async def remove(self, user: str) -> None:
        """Remove a user, as `fleetsight users remove` does, and have the monitor notice."""
        await self.users.remove(user)
        await self.access.look()


def monitor_on(bus: Bus, *, plan: FloorPlan | None = None, **given: Any) -> Monitor:
    """Return a monitor without history, unless `given` settings say otherwise; nothing of it runs."""
    settings = MonitorSettings(**{"history": "none", "web_port": 0, **given})
    fleet = Fleet("clock")
    fleet.world = World(on=settings.follows_world)
    rules, zones = RuleFile(settings.rules), ZoneFile(settings.zones, fleet.world)
    alerting = Alerting(rules, fleet.inventory, hears(), settle_s=0)
    history = HistoryWriter(settings, fleet.inventory, alerting.lead, world=(fleet.world, fleet.sites))
    return Monitor(settings, bus, fleet, rules, alerting, history, Archive(settings.history), Health(bus), plan, zones)


@asynccontextmanager
async def served(monitor: Monitor, role: Role = Role.OPERATOR, folder: Path | None = None) -> AsyncIterator[Served]:
    """Serve page and API on a free port; a user of the role is logged in. folder: where its users are kept."""
    nicegui_app.middleware_stack = None  # the page's application outlives each server of this process
    nicegui_app.user_middleware.clear()
    listener = open_listener(monitor.settings)
    url, port = url_of(listener, monitor.settings), listener.getsockname()[1]
    with TemporaryDirectory() as made:
        folder = folder or Path(made)
        access = await access_in(folder)
        serving = asyncio.create_task(serve(monitor, listener, access))
        try:
            async with asyncio.timeout(60), httpx.AsyncClient(timeout=60) as client:
                await client.get(f"http://127.0.0.1:{port}/healthz")
            session = await access.log_in(role, PASSWORD, "here")
            token = await token_of(access, folder, role)
            yield Served(url, (cookie_of(monitor.settings), session), token, access, UserStore(users_in(folder)))
        finally:
            serving.cancel()
            with suppress(asyncio.CancelledError):
                await serving


async def access_in(folder: Path) -> Access:
    """Return who may log in where there are two users, called like their roles."""
    store = UserStore(users_in(folder))
    hashed = await Passwords().hash(PASSWORD)
    for role in Role:
        await store.add(User(role, role, hashed, 1))
    access = Access(store, session_hours=1)
    await access.look()
    return access


async def token_of(access: Access, folder: Path, user: str) -> str:
    """Return a token of one of the users."""
    secret = new_secret(Kind.TOKEN)
    login = Login(digest_of(secret), user, Kind.TOKEN, 1, 2**62)
    await UserStore(users_in(folder)).keep([login], [], [], 0)
    await access.look()
    return secret


def users_in(folder: Path) -> str:
    """Return the database of the users."""
    return f"sqlite:///{folder / 'users.db'}"
