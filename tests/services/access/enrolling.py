"""An authority that serves machines on loopback, in the test's own loop."""

import asyncio
import contextlib
import socket
import ssl
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeVar

from cryptography import x509

from services.access import enrolment_client
from services.access.authority import Authority
from services.access.enrolment_client import Files
from services.access.enrolment_protocol import Token
from services.access.enrolment_server import EnrolmentServer
from services.access.invitations import Invitations

T = TypeVar("T")
Stream = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class Serving(NamedTuple):
    """An authority, and where machines enrol."""

    authority: Authority
    address: tuple[str, int]

    def invite(self, name: str, *, hours: float = 1, days: float = 7, replace: bool = False) -> Token:
        """Make a token."""
        until = datetime.now(UTC) + timedelta(hours=hours)
        return Invitations(self.authority).make(name, until=until, days=days, replace=replace)

    async def enrol(self, token: Token, folder: Path) -> x509.Certificate:
        """Enrol as another machine would."""
        return await _elsewhere(partial(enrolment_client.enrol, token, self.address, Files(folder, token.name)))

    async def renew(self, name: str, folder: Path, *, after: timedelta = timedelta(days=6)) -> x509.Certificate | None:
        """Renew a certificate so much later, by the clock of its machine."""
        now = datetime.now(UTC) + after
        return await _elsewhere(partial(enrolment_client.renew, name, self.address, Files(folder, name), now=now))

    async def connect(self) -> Stream:
        """Open a TCP connection."""
        return await asyncio.open_connection(*self.address)

    async def connect_tls(self) -> Stream:
        """Open a TLS connection, without a certificate and without looking at the server's."""
        tls = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        tls.check_hostname, tls.verify_mode = False, ssl.CERT_NONE
        return await asyncio.open_connection(*self.address, ssl=tls)


async def _elsewhere(act: Callable[[], T]) -> T:
    """Do something as other machines would: without one of the server's threads."""
    with ThreadPoolExecutor(1) as machine:
        return await asyncio.get_running_loop().run_in_executor(machine, act)


def new_authority(folder: Path) -> Authority:
    authority = Authority(folder)
    authority.make()
    return authority


@contextlib.asynccontextmanager
async def serving(authority: Authority, fleet: Path | None = None) -> AsyncIterator[Serving]:
    """Run an authority's server."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(0)
        task = asyncio.create_task(EnrolmentServer(authority, fleet).serve(listening))
        try:
            yield Serving(authority, listening.getsockname())
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
