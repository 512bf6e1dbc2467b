"""The web server as a part of the monitor: its start, its problems, its end."""

import asyncio
import errno
import ipaddress
import logging
import os
import socket
import ssl
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Final, Self

from bus import BusError
from bus.session.certificates import check_pair
from bus.session.changed_files import LOOKED_AT_S, ChangedFiles
from services.monitor.event_loop.blocking_calls import in_daemon_thread
from services.monitor.monitor import Monitor
from services.monitor.settings import MonitorSettings, WebSettings
from services.monitor.web.auth.logins import Access
from services.monitor.web.auth.store import UserStore, users_url


class WebError(Exception):
    """The web server cannot start; the message names the cause."""


_OF_PORTS: Final = (errno.EADDRINUSE, errno.EACCES)
"""Errors that another port may solve."""


def open_listener(settings: WebSettings) -> socket.socket:
    """Return a listening socket for the settings.

    Raises:
        WebError: the address or port cannot be had.
    """
    where = f"--web-host {settings.web_host} --web-port {settings.web_port}"
    try:
        found = socket.getaddrinfo(
            settings.web_host, settings.web_port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        family, _, _, _, address = found[0]
        listener = socket.create_server((str(address[0]), int(address[1])), family=family)
    except (OSError, UnicodeError) as error:
        number = error.errno if isinstance(error, OSError) else None
        of_names = error.strerror if isinstance(error, socket.gaierror) else str(error)
        reason = os.strerror(number) if number is not None and number > 0 else of_names
        wrong = "--web-port" if number in _OF_PORTS else "--web-host"
        raise WebError(f"{where}: {reason}; set another {wrong}, or --no-web") from error
    listener.setblocking(False)  # noqa: FBT003 - the standard library's
    return listener


def url_of(listener: socket.socket, settings: WebSettings) -> str:
    """Return the address for a browser, without a trailing slash."""
    scheme = "http" if settings.web_certificate is None else "https"
    if settings.web_url is not None:
        return str(settings.web_url).rstrip("/")
    host, port = listener.getsockname()[:2]
    if ipaddress.ip_address(host).is_unspecified:
        host = socket.gethostname()
    return f"{scheme}://[{host}]:{port}" if ":" in host else f"{scheme}://{host}:{port}"


async def machine_names() -> frozenset[str]:
    """Return this machine's names in lower case: its own, that for mDNS, and that with its domain if found soon."""
    name = socket.gethostname().lower()
    short = name.partition(".")[0]
    names = {name, short, f"{short}.local"}

    def ask() -> None:
        names.add(socket.getfqdn(name).lower().removesuffix("."))

    with suppress(TimeoutError):
        async with asyncio.timeout(NAMES_S):
            await in_daemon_thread(ask)
    return frozenset(names)


NAMES_S: Final = 2.0
"""Seconds allowed for a name server to say which domain this machine is in."""

log = logging.getLogger(__name__)


class PageTls:
    """The page's own certificate and key, taken anew when they change; open connections keep what they began with.

    Raises:
        BusError: a file cannot be used; the message names its setting.
    """

    def __init__(self, certificate: Path, key: Path) -> None:
        self._pair = certificate, key
        self._files = ChangedFiles(self._pair)
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        check_pair(*self._named_pair)
        self._load()

    async def keep_current(self) -> None:
        """Take changed files, forever; those that cannot be used are named in the log and left."""
        while True:
            await asyncio.sleep(LOOKED_AT_S)
            if not await asyncio.to_thread(self._files.changed):
                continue
            self._files.use()
            try:
                await asyncio.to_thread(check_pair, *self._named_pair)
                self._load()  # here, where connections begin: between certificate and key they would fail
            except (BusError, OSError) as error:
                log.warning("%s; the page uses the previous certificate until this is fixed", error)
            else:
                log.info("the page's certificate has changed; new connections use it")

    @property
    def _named_pair(self) -> tuple[str, Path, str, Path]:
        certificate, key = self._pair
        return "web_certificate", certificate, "web_key", key

    def _load(self) -> None:
        certificate, key = self._pair
        self.context.load_cert_chain(certificate, key, password="")


@dataclass(frozen=True, slots=True)
class Web:
    """A web server whose port is open, but which is not serving yet. url: of the page. tls: of its own, or none."""

    url: str
    listener: socket.socket
    access: Access
    tls: PageTls | None = None

    @classmethod
    def of(cls, settings: MonitorSettings) -> Self:
        """Open the port; raises WebError, or BusError for certificates."""
        tls = None
        if settings.web_certificate is not None and settings.web_key is not None:
            tls = PageTls(settings.web_certificate, settings.web_key)
        listener = open_listener(settings)
        url = url_of(listener, settings)
        if not (url.startswith("https:") or ipaddress.ip_address(listener.getsockname()[0]).is_loopback):
            log.warning(
                "passwords cross the network unencrypted: give --web-certificate and --web-key, or put a TLS proxy"
                " in front and set --web-url"
            )
        access = Access(UserStore(users_url(settings.history)), settings.web_session_hours, url)
        return cls(url, listener, access, tls)

    async def run(self, monitor: Monitor) -> None:
        """Serve until cancelled."""
        await in_daemon_thread(partial(import_module, "services.monitor.web.server"))  # the import takes a second
        from services.monitor.web.server import serve  # noqa: PLC0415 - 60 MB, for who serves alone

        async with asyncio.TaskGroup() as group:
            group.create_task(self.access.run())
            if self.tls is not None:
                group.create_task(self.tls.keep_current())
            tls = None if self.tls is None else self.tls.context
            await serve(monitor, self.listener, self.access, tls, await machine_names())

    def notes(self) -> list[str]:
        """Return notes for the terminal."""
        invitation, problem = self.access.invitation, self.access.problem
        return [f"first user: {invitation}"] * bool(invitation) + [problem] * bool(problem)
