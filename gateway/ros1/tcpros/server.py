"""Accepts subscribers' TCPROS connections and hands each to the publication it asks for."""

from __future__ import annotations

import asyncio
import logging
import socket
from contextlib import closing
from typing import TYPE_CHECKING, Self

from gateway.ros1.errors import TcprosError, WireError
from gateway.ros1.listening import Acceptor, listen
from gateway.ros1.tasks import cancel_and_wait
from gateway.ros1.tcpros.keepalive import notice_dead_peer
from gateway.ros1.wire.framing import FrameBudget
from gateway.ros1.wire.header import MAX_HEADER_BYTES
from gateway.ros1.wire.tcpros import PublisherConnection, SubscriberRefused

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import TracebackType

    from gateway.ros1.tasks import TaskScope
    from gateway.ros1.tcpros.publisher import Publication
    from gateway.ros1.wire.tcpros import PublisherEvent

log = logging.getLogger(__name__)
_MAX_CONNECTIONS = 256
_UNFINISHED_HEADERS = 4  # of the largest size, of all subscribers together


class TcprosServer:
    """One listener for all publications of a node, whose name may change; its tasks live in the node's scope."""

    def __init__(
        self,
        *,
        callerid: Callable[[], str],
        host: str,
        publications: Mapping[str, Publication],
        scope: TaskScope,
        timeout: float,
    ) -> None:
        self._callerid = callerid
        self._host = host
        self._publications = publications
        self._scope = scope
        self._timeout = timeout
        self._budget = FrameBudget(_UNFINISHED_HEADERS * MAX_HEADER_BYTES)
        self._connections: set[asyncio.Task[None]] = set()
        self._acceptor: Acceptor | None = None
        self._port = 0

    @property
    def address(self) -> tuple[str, int]:
        """The address for subscribers; known once entered."""
        return self._host, self._port

    async def __aenter__(self) -> Self:
        listener = listen(self._host)
        self._port = listener.getsockname()[1]
        self._acceptor = Acceptor(listener, self._start)
        return self

    async def __aexit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _traceback: TracebackType | None
    ) -> None:
        if self._acceptor is not None:
            self._acceptor.close()
        await cancel_and_wait(set(self._connections))

    def _start(self, connection: socket.socket, peer: str) -> None:
        if len(self._connections) >= _MAX_CONNECTIONS:
            log.warning("%s is turned away: %d subscribers already", peer, _MAX_CONNECTIONS)
            connection.close()
            return
        task = self._scope.start(self._serve(connection, peer), f"subscriber {peer}")
        self._connections.add(task)
        task.add_done_callback(self._connections.discard)
        task.add_done_callback(lambda _: connection.close())

    async def _serve(self, connection: socket.socket, peer: str) -> None:
        try:
            async with asyncio.timeout(self._timeout):
                event = await self._handshake(connection)
        except (WireError, OSError) as error:
            log.warning("%s is not a subscriber: %r", peer, error)
            return
        if isinstance(event, SubscriberRefused):
            log.warning("%s is refused: %s", peer, event.reason)
            return
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, int(event.tcp_nodelay))
        notice_dead_peer(connection)
        publication = self._publications.get(event.topic)
        if publication is not None:
            await publication.serve(connection, event)

    async def _handshake(self, connection: socket.socket) -> PublisherEvent:
        """Return the answer to the subscriber's header; a refusal has already been sent."""
        loop = asyncio.get_running_loop()
        offers = {topic: publication.offer for topic, publication in self._publications.items()}
        protocol = PublisherConnection(callerid=self._callerid(), offers=offers, budget=self._budget)
        with closing(protocol):
            while data := await loop.sock_recv(connection, 4096):
                event = protocol.receive_data(data)
                if isinstance(event, SubscriberRefused):
                    await loop.sock_sendall(connection, event.reply)
                if event is not None:
                    return event
        raise TcprosError("the connection ended before the header did")
