"""The socket under one subscriber connection."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from gateway.ros1.errors import Ros1Error, TcprosError, UnreachableError
from gateway.ros1.tcpros.keepalive import notice_dead_peer

if TYPE_CHECKING:
    from collections.abc import Callable

    from gateway.ros1.resolver import Resolver
    from gateway.ros1.wire.tcpros import SubscriberConnection, SubscriberEvent


MESSAGE_TIMEOUT_S: Final = 30.0


async def run_link(
    address: tuple[str, int],
    connection: SubscriberConnection,
    on_event: Callable[[SubscriberEvent], None],
    *,
    resolver: Resolver,
    handshake_timeout: float,
    message_timeout: float = MESSAGE_TIMEOUT_S,
) -> None:
    """Connect and pass on events until the publisher closes the stream.

    Raises:
        UnreachableError: no connection, or no header, within `handshake_timeout` seconds.
        TcprosError: a message is not whole `message_timeout` to twice as many seconds after it began.
        Ros1Error: what the connection or `on_event` raised.

    """
    host, port = address
    link = _Link(connection, on_event)
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(handshake_timeout):
            await resolver.connect(host, lambda found: loop.create_connection(lambda: link, found, port))
            await link.first_event.wait()
    except (TimeoutError, OSError, UnicodeError) as error:  # UnicodeError: not a possible host name
        await link.abort()
        late = f"{'no header' if link.is_connected else 'no answer'} within {handshake_timeout:g} s"
        reason = late if isinstance(error, TimeoutError) else repr(error)
        raise UnreachableError(f"no TCPROS connection to {host}:{port}: {reason}") from error
    except BaseException:
        await link.abort()
        raise
    try:
        await _until_lost(link, connection, message_timeout)
    finally:
        await link.abort()
    if link.error is not None:
        raise link.error


async def _until_lost(link: _Link, connection: SubscriberConnection, message_timeout: float) -> None:
    while not link.lost.is_set():
        before = connection.message_under_way
        with suppress(TimeoutError):
            async with asyncio.timeout(message_timeout):
                await link.lost.wait()
        if before is not None and connection.message_under_way == before and not link.lost.is_set():
            raise TcprosError(f"a message is not whole after {message_timeout} s")


class _Link(asyncio.BufferedProtocol):
    def __init__(self, connection: SubscriberConnection, on_event: Callable[[SubscriberEvent], None]) -> None:
        self.first_event = asyncio.Event()
        self.lost = asyncio.Event()
        self.error: Ros1Error | None = None
        self._connection = connection
        self._on_event = on_event
        self._transport: asyncio.Transport | None = None

    @property
    def is_connected(self) -> bool:
        """Whether a connection was ever made."""
        return self._transport is not None

    async def abort(self) -> None:
        """Close the socket at once; returns when it is closed."""
        if self._transport is not None:
            self._transport.abort()
            await self.lost.wait()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - what create_connection makes
        self._transport = transport
        notice_dead_peer(transport.get_extra_info("socket"))
        transport.write(self._connection.opening)

    def connection_lost(self, exc: Exception | None) -> None:
        if self.error is None and not self.first_event.is_set():
            self.error = UnreachableError(f"the connection ended before the header did: {exc or 'end of stream'}")
        self._connection.close()
        self.lost.set()
        self.first_event.set()

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002 - the length prefix knows better
        return self._connection.get_buffer()

    def buffer_updated(self, nbytes: int) -> None:
        if self.error is not None:
            return
        try:
            self._connection.buffer_updated(nbytes)
            while (event := self._connection.next_event()) is not None:
                self._on_event(event)
                if not self.first_event.is_set():
                    self.first_event.set()
        except Ros1Error as error:
            self.error = error.with_traceback(None)  # its frames hold what came of the message
            if self._transport is not None:
                self._transport.abort()
