"""Accepts the web server's connections, opens TLS on them, and closes those over a limit before anything is read."""

import asyncio
import logging
import socket
import ssl
from collections.abc import Callable, Iterator
from typing import Any, Final

from uvicorn.server import ServerState

from services.accepting import accepted

log = logging.getLogger(__name__)

TURNED_AWAY: Final = 50
"""Connections over the limit that get a 503; further ones are closed."""

SHARE: Final = 4
"""One address has at most one in so many of all connections: what it does not use is left to others."""

FEWEST: Final = 16
"""Connections that an address may always have: a browser opens six."""

PROXIES: Final = frozenset({"127.0.0.1", "::1"})
"""Addresses without such a limit: a proxy on this machine speaks for everybody."""

HANDSHAKE_S: Final = 10.0
"""Seconds allowed for a TLS handshake, however it goes on."""

CLOSE_S: Final = 5.0
"""Seconds for which a TLS connection that was closed waits for its other end to agree."""


class Acceptor:
    """Accepts connections until cancelled; those still in their TLS handshake count, too.

    Where all connections are taken, the oldest handshake gives way to a new connection: an honest one takes a moment.

    state: the server's connections. protocol: makes one for each. most: connections; TURNED_AWAY more are accepted.
    tls: whether and how to open it.
    """

    def __init__(
        self,
        state: ServerState,
        protocol: Callable[[], asyncio.Protocol],
        most: int,
        tls: ssl.SSLContext | None = None,
        *,
        handshake_s: float = HANDSHAKE_S,
    ) -> None:
        self._state = state
        self._protocol = protocol
        self._most = most
        self._options: dict[str, Any] = {}
        if tls is not None:
            self._options = {"ssl": tls, "ssl_handshake_timeout": handshake_s, "ssl_shutdown_timeout": CLOSE_S}
        self._opening: dict[asyncio.Task[None], str] = {}

    async def run(self, listener: socket.socket) -> None:
        """Accept what connects to a non-blocking socket."""
        async with asyncio.TaskGroup() as group:
            async for connected, address in accepted(listener):
                if not self._has_room(address):
                    connected.close()
                    continue
                opening = group.create_task(self._open(connected, address))
                self._opening[opening] = address
                opening.add_done_callback(lambda done: self._opening.pop(done, None))

    def _has_room(self, address: str) -> bool:
        if address not in PROXIES and self._of(address) >= max(FEWEST, self._most // SHARE):
            return False
        if len(self._state.connections) + len(self._opening) < self._most + TURNED_AWAY:
            return True
        for oldest in self._opening:
            del self._opening[oldest]
            oldest.cancel()
            return True
        return False

    def _of(self, address: str) -> int:
        """Return how many connections an address has."""
        return sum(each == address for each in self._addresses())

    def _addresses(self) -> Iterator[str]:
        yield from self._opening.values()
        for connection in self._state.connections:
            client = getattr(connection, "client", None)
            if client is not None:
                yield client[0]

    async def _open(self, connected: socket.socket, address: str) -> None:
        try:
            await asyncio.get_running_loop().connect_accepted_socket(self._protocol, connected, **self._options)
        except OSError as error:  # also what TLS says
            log.debug("no connection from %s: %s", address, error)
