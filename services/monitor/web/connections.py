"""Accepts the web server's connections, opens TLS on them, and closes those over a limit before anything is read."""

import asyncio
import logging
import socket
import ssl
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, NamedTuple

from uvicorn.server import ServerState

from services.accepting import accepted

log = logging.getLogger(__name__)

TURNED_AWAY: Final = 50
"""Connections over the limit that get a 503; further ones are closed."""

SHARE: Final = 4
"""One address, and one user, has at most one in so many of all connections: the rest is left to others."""

FEWEST: Final = 16
"""Connections that an address or a user may always have: a browser opens six."""

SPARE: Final = 20
"""One in so many connections is left free of strangers and handshakes."""

PROXIES: Final = frozenset({"127.0.0.1", "::1"})
"""Addresses without such a limit: a proxy on this machine speaks for everybody."""

HANDSHAKE_S: Final = 10.0
"""Seconds allowed for a TLS handshake, however it goes on."""

KNOWN: Final = "fleetsight.known"
"""The key, in a request's scope, of the function that marks its connection as that of somebody logged in."""


def share_of(most: int) -> int:
    """Return how many of the connections one address or user may have."""
    return max(FEWEST, most // SHARE)


class Connection:
    """A connection for requests. is_stranger: nobody who is logged in has asked for anything on it yet."""

    opened_s: float
    is_stranger: bool
    transport: asyncio.Transport


CLOSE_S: Final = 5.0
"""Seconds for which a TLS connection that was closed waits for its other end to agree."""


class _Opening(NamedTuple):
    """A connection that is being opened."""

    address: str
    begun_s: float


class Acceptor:
    """Accepts connections until cancelled; those still in their TLS handshake count, too.

    Where nearly all connections are taken, the oldest of these gives way to a new one: a handshake, as an honest one
    takes a moment, or a connection on which nobody was logged in yet.

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
        self._opening: dict[asyncio.Task[None], _Opening] = {}

    async def run(self, listener: socket.socket) -> None:
        """Accept what connects to a non-blocking socket."""
        async with asyncio.TaskGroup() as group:
            async for connected, address in accepted(listener):
                if not self._has_room(address):
                    connected.close()
                    continue
                opening = group.create_task(self._open(connected, address))
                self._opening[opening] = _Opening(address, asyncio.get_running_loop().time())
                opening.add_done_callback(lambda done: self._opening.pop(done, None))

    def _has_room(self, address: str) -> bool:
        if address not in PROXIES and self._of(address) >= share_of(self._most):
            return False
        taken = len(self._state.connections) + len(self._opening)
        # The server answers 503 from the last connection on, and one that is aborted counts until it is gone.
        spare = max(1, self._most // SPARE)
        return taken < self._most - spare or self._has_made_room() or taken < self._most + TURNED_AWAY

    def _has_made_room(self) -> bool:
        """Close the oldest handshake or stranger's connection; return whether there was one."""
        every: Iterable[object] = self._state.connections
        strangers = (each for each in every if isinstance(each, Connection) and each.is_stranger)
        stranger = min(strangers, key=lambda each: each.opened_s, default=None)
        # Without TLS to open a connection takes no time.
        opening, begun_s = next(
            ((each, of.begun_s) for each, of in self._opening.items() if self._options), (None, 0.0)
        )
        if opening is not None and (stranger is None or begun_s < stranger.opened_s):
            del self._opening[opening]
            opening.cancel()
        elif stranger is not None:
            stranger.is_stranger = False
            stranger.transport.abort()
        return opening is not None or stranger is not None

    def _of(self, address: str) -> int:
        """Return how many connections an address has."""
        return sum(each == address for each in self._addresses())

    def _addresses(self) -> Iterator[str]:
        yield from (each.address for each in self._opening.values())
        for connection in self._state.connections:
            client = getattr(connection, "client", None)
            if client is not None:
                yield client[0]

    async def _open(self, connected: socket.socket, address: str) -> None:
        try:
            await asyncio.get_running_loop().connect_accepted_socket(self._protocol, connected, **self._options)
        except OSError as error:  # also what TLS says
            log.debug("no connection from %s: %s", address, error)
