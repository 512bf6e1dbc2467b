"""The web application asked in memory, without a socket."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
from fastapi import FastAPI

from bus.fake import FakeNetwork
from services.monitor.monitor import Monitor
from services.monitor.web.application import cookie_of, guarded, make_application
from services.monitor.web.auth.logins import Access
from services.monitor.web.auth.users import Role
from tests.services.monitor.web.serving import PASSWORD, access_in, monitor_on, token_of

ORIGIN = "http://localhost:1"


@dataclass(frozen=True)
class Web:
    """A monitor's web application. folder: where its users are."""

    monitor: Monitor
    access: Access
    app: FastAPI
    folder: Path

    def stranger(self, address: str = "10.0.0.1", **headers: str) -> httpx.AsyncClient:
        """Return who is not logged in."""
        transport = httpx.ASGITransport(
            guarded(self.app, self.access, self.monitor.settings),
            client=(address, 1),
            raise_app_exceptions=False,
        )
        return httpx.AsyncClient(transport=transport, base_url=ORIGIN, headers=headers)

    async def program(self, role: Role = Role.OPERATOR) -> httpx.AsyncClient:
        """Return a program with a token."""
        return self.stranger(Authorization=f"Bearer {await token_of(self.access, self.folder, role)}")

    async def browser(self, role: Role = Role.OPERATOR) -> httpx.AsyncClient:
        """Return a browser in which somebody is logged in; it names its page's origin, as browsers do."""
        client = self.stranger(Origin=ORIGIN)
        client.cookies.set(cookie_of(self.monitor.settings), await self.access.log_in(role, PASSWORD, "here"))
        return client


@asynccontextmanager
async def web_in(folder: Path, **given: Any) -> AsyncIterator[Web]:
    """Make one with two users, called like their roles."""
    async with FakeNetwork().open_bus() as bus:
        monitor, access = monitor_on(bus, **given), await access_in(folder)
        await monitor.history.restore()
        yield Web(monitor, access, make_application(monitor, access), folder)
