"""The web server as a part of a monitor's process."""

import asyncio
import ipaddress
import logging
import socket
from dataclasses import dataclass
from typing import Self

from services.monitor.monitor import Monitor
from services.monitor.settings import MonitorSettings
from services.monitor.web.auth.access import Access
from services.monitor.web.auth.store import UserStore, users_url
from services.monitor.web.door import open_door, url_of

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Web:
    """A web server that has its port and is not serving yet. url: where the page is."""

    url: str
    door: socket.socket
    access: Access

    @classmethod
    def of(cls, settings: MonitorSettings) -> Self:
        """Take the port; raises WebError."""
        door = open_door(settings)
        url = url_of(door, settings)
        if not (url.startswith("https:") or ipaddress.ip_address(door.getsockname()[0]).is_loopback):
            log.warning(
                "passwords cross the network unencrypted: have a proxy with TLS before it, and name it: --web-url"
            )
        return cls(url, door, Access(UserStore(users_url(settings.history)), settings.web_session_hours, url))

    async def run(self, monitor: Monitor) -> None:
        """Serve for ever."""
        from services.monitor.web.server import serve  # noqa: PLC0415 - takes a second and 60 MB, for who serves alone

        async with asyncio.TaskGroup() as group:
            group.create_task(self.access.run())
            group.create_task(serve(monitor, self.door, self.access))

    def notes(self) -> list[str]:
        """Say what whoever looks at the terminal should know."""
        return [f"first user: {self.access.invitation}"] if self.access.needs_setup else []
