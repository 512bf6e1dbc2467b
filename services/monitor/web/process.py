"""The web server as a part of a monitor's process."""

import asyncio
import ipaddress
import logging
import socket
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Self

from services.monitor.aside import aside
from services.monitor.monitor import Monitor
from services.monitor.settings import MonitorSettings
from services.monitor.web.auth.access import Access
from services.monitor.web.auth.store import UserStore, users_url
from services.monitor.web.listener import open_listener, url_of

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Web:
    """A web server that has its port and is not serving yet. url: where the page is."""

    url: str
    listener: socket.socket
    access: Access

    @classmethod
    def of(cls, settings: MonitorSettings) -> Self:
        """Take the port; raises WebError."""
        listener = open_listener(settings)
        url = url_of(listener, settings)
        if not (url.startswith("https:") or ipaddress.ip_address(listener.getsockname()[0]).is_loopback):
            log.warning(
                "passwords cross the network unencrypted: have a proxy with TLS before it, and name it: --web-url"
            )
        return cls(url, listener, Access(UserStore(users_url(settings.history)), settings.web_session_hours, url))

    async def run(self, monitor: Monitor) -> None:
        """Serve for ever."""
        await aside(partial(import_module, "services.monitor.web.server"))  # a second's work
        from services.monitor.web.server import serve  # noqa: PLC0415 - 60 MB, for who serves alone

        async with asyncio.TaskGroup() as group:
            group.create_task(self.access.run())
            await serve(monitor, self.listener, self.access)

    def notes(self) -> list[str]:
        """Say what whoever looks at the terminal should know."""
        invitation, problem = self.access.invitation, self.access.problem
        return [f"first user: {invitation}"] * bool(invitation) + [problem] * bool(problem)
