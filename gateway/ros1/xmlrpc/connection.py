"""Connections to an XML-RPC server, bounded in number and in the memory that they hold."""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress
from typing import TYPE_CHECKING

from gateway.ros1.errors import HttpError, WireError
from gateway.ros1.wire.http import ServerExchange

if TYPE_CHECKING:
    from collections.abc import Callable

    from gateway.ros1.wire.xmlrpc import MethodCall

log = logging.getLogger(__name__)


class Connections:
    """The open connections: at most `limit`, with at most `max_held_bytes` of unfinished requests together."""

    def __init__(self, *, limit: int, max_held_bytes: int) -> None:
        self._limit = limit
        self._max_held_bytes = max_held_bytes
        self._held: dict[ServerConnection, int] = {}

    def admit(self, connection: ServerConnection) -> bool:
        """Add a connection; return whether there was room for it."""
        if len(self._held) >= self._limit:
            log.warning("%s is turned away: %d connections already", connection.peer, self._limit)
            return False
        self._held[connection] = 0
        return True

    def hold(self, connection: ServerConnection, held_bytes: int) -> None:
        """Set the bytes that a connection holds; when the total is too large, the largest holder is closed."""
        self._held[connection] = held_bytes
        if sum(self._held.values()) > self._max_held_bytes:
            most = max(self._held, key=self._held.__getitem__)
            log.warning("%s is cut off: its request of %d bytes is the largest", most.peer, self._held[most])
            self._held[most] = 0
            most.abort()

    def forget(self, connection: ServerConnection) -> None:
        """Remove a connection that has ended."""
        self._held.pop(connection, None)

    async def end(self, grace_s: float) -> None:
        """End all connections and wait until they are closed, after a short grace period for pending answers."""
        connections = list(self._held)
        leaving = [connection.lost.wait() for connection in connections if connection.answered]
        try:
            with suppress(TimeoutError):
                async with asyncio.timeout(grace_s):
                    await asyncio.gather(*leaving)
        finally:
            for connection in connections:
                connection.abort()
        for connection in connections:
            await connection.lost.wait()


class ServerConnection(asyncio.Protocol):
    """Reads one call and sends one answer; invalid requests are refused, and the rest of them is discarded."""

    def __init__(
        self,
        connections: Connections,
        answer: Callable[[MethodCall, str], bytes],
        *,
        timeout: float,
        max_body_bytes: int,
    ) -> None:
        self.peer = ""
        self.answered = False
        self.lost = asyncio.Event()
        self._connections = connections
        self._answer = answer
        self._timeout = timeout
        self._exchange = ServerExchange(max_body_bytes)
        self._held_bytes = 0
        self._transport: asyncio.Transport
        self._deadline: asyncio.TimerHandle | None = None

    def abort(self) -> None:
        """Close the socket at once."""
        self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - what create_server makes
        self._transport = transport
        self.peer = transport.get_extra_info("peername", ("a peer that has left",))[0]
        if self._connections.admit(self):
            self._deadline = asyncio.get_running_loop().call_later(self._timeout, self.abort)
        else:
            self.abort()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - however it ended
        if self._deadline is not None:
            self._deadline.cancel()
        self._exchange.close()
        self._connections.forget(self)
        self.lost.set()

    def data_received(self, data: bytes) -> None:
        if not self.answered:
            self._held_bytes += len(data)
            self._take(data)

    def eof_received(self) -> None:
        if self._held_bytes and not self.answered:
            self._take(b"")

    def _take(self, data: bytes) -> None:
        try:
            call = self._exchange.receive_data(data)
        except WireError as error:
            log.warning("%s sent a request that is not XML-RPC: %s", self.peer, error)
            # If closed with unread data, the peer might see a broken connection instead of the answer.
            self._send(self._exchange.refuse(error.status if isinstance(error, HttpError) else 400)).write_eof()
            return
        if call is None:
            self._connections.hold(self, self._held_bytes)
        else:
            self._send(self._exchange.answer(self._answer(call, self.peer))).close()

    def _send(self, data: bytes) -> asyncio.Transport:
        self.answered = True
        self._connections.hold(self, 0)
        self._transport.write(data)
        return self._transport
