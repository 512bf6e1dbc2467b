"""Publication of one topic, with a bounded queue for each subscriber, so that none delays another."""

from __future__ import annotations

import asyncio
import socket
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gateway.ros1.tasks import TaskScope
from gateway.ros1.tcpros.keepalive import is_gone
from gateway.ros1.wire.tcpros import message_prefix

if TYPE_CHECKING:
    from collections.abc import Callable

    from gateway.ros1.wire.tcpros import Offer, SubscriberAccepted

# Below this size a message and its prefix are joined, so that they leave in one segment.
_JOIN_BYTES = 64 << 10
_LOOK_S = 5.0  # between checks whether a subscriber is still there


@dataclass(slots=True)
class PublicationCounters:
    """`sent` and `replaced` messages, summed over subscribers; `bytes` counts what was sent."""

    sent: int = 0
    replaced: int = 0
    bytes: int = 0


class Publication:
    """Publishes serialised messages to connected subscribers; with `latch`, the last one to new ones too.

    `on_demand` is called on the event loop when the first subscriber comes and when the last one goes, until closing.
    Subscribers whose nodes' names are `passive` do not count for that; they get what is published as all others do.
    """

    def __init__(
        self,
        offer: Offer,
        *,
        queue_size: int,
        on_demand: Callable[[bool], None] | None = None,
        passive: Callable[[str], bool] | None = None,
    ) -> None:
        if queue_size < 1:
            raise ValueError(f"queue_size must be at least 1, not {queue_size}")
        self.offer = offer
        self.counters = PublicationCounters()
        self._queue_size = queue_size
        self._last: bytes | None = None
        self._outgoing: set[_Outgoing] = set()
        self._on_demand = on_demand
        self._passive = passive
        self._wanted = False

    @property
    def topic(self) -> str:
        return self.offer.topic

    @property
    def subscriber_count(self) -> int:
        return len(self._outgoing)

    @property
    def wanted(self) -> bool:
        """Whether a subscriber that is not passive is connected."""
        return any(not (self._passive and self._passive(outgoing.callerid)) for outgoing in self._outgoing)

    def publish(self, message: bytes) -> None:
        """Queue a message for every subscriber; where the queue is full, its oldest message is replaced."""
        message_prefix(len(message))
        if self.offer.latching:
            self._last = message
        for outgoing in self._outgoing:
            self.counters.replaced += outgoing.put(message)

    async def serve(self, connection: socket.socket, subscriber: SubscriberAccepted) -> None:
        """Send the reply, then messages, until the subscriber leaves or the publication is closed."""
        outgoing = _Outgoing(connection, subscriber.callerid, self._queue_size)
        if self._last is not None:
            outgoing.put(self._last)
        self._outgoing.add(outgoing)
        self._tell_demand()
        try:
            async with TaskScope() as scope:
                scope.start(self._send(outgoing, subscriber.reply), f"{self.topic} to {subscriber.callerid}")
                await _until_left(connection)
        finally:
            self._outgoing.discard(outgoing)
            self._tell_demand()

    def close(self) -> None:
        """End every subscriber's connection; queued messages are lost."""
        self._on_demand = None
        for outgoing in self._outgoing:
            with suppress(OSError):
                outgoing.connection.shutdown(socket.SHUT_RDWR)

    def bus_stats(self) -> list[Any]:
        """Return `[topic, bytes, [[id, bytes, messages, connected]...]]`."""
        links = [[i, outgoing.bytes, outgoing.sent, True] for i, outgoing in enumerate(self._outgoing)]
        return [self.topic, self.counters.bytes, links]

    def bus_info(self) -> list[Any]:
        """Return `[id, subscriber, direction, transport, topic, connected]` of each connection."""
        return [[i, o.callerid, "o", "TCPROS", self.topic, True] for i, o in enumerate(self._outgoing)]

    def _tell_demand(self) -> None:
        wanted = self.wanted
        if self._on_demand is not None and wanted != self._wanted:
            self._wanted = wanted
            self._on_demand(wanted)

    async def _send(self, outgoing: _Outgoing, reply: bytes) -> None:
        loop = asyncio.get_running_loop()
        with suppress(OSError):  # the reading side sees the end of the connection too
            await loop.sock_sendall(outgoing.connection, reply)
            while True:
                message = await outgoing.get()
                await _send_message(outgoing.connection, message)
                outgoing.sent += 1
                outgoing.bytes += len(message)
                self.counters.sent += 1
                self.counters.bytes += len(message)


class _Outgoing:
    """The queue of one subscriber."""

    def __init__(self, connection: socket.socket, callerid: str, size: int) -> None:
        self.connection = connection
        self.callerid = callerid
        self.sent = 0
        self.bytes = 0
        self._messages: deque[bytes] = deque(maxlen=size)
        self._waiting = asyncio.Event()

    def put(self, message: bytes) -> int:
        """Queue a message; return the number of messages it replaced."""
        replaced = int(len(self._messages) == self._messages.maxlen)
        self._messages.append(message)
        self._waiting.set()
        return replaced

    async def get(self) -> bytes:
        while not self._messages:
            self._waiting.clear()
            await self._waiting.wait()
        return self._messages.popleft()


async def _send_message(connection: socket.socket, message: bytes) -> None:
    loop = asyncio.get_running_loop()
    prefix = message_prefix(len(message))
    if len(message) < _JOIN_BYTES:
        await loop.sock_sendall(connection, prefix + message)
        return
    await loop.sock_sendall(connection, prefix)
    await loop.sock_sendall(connection, message)


async def _until_left(connection: socket.socket) -> None:
    """Return when the subscriber closes the connection or has vanished silently."""
    loop = asyncio.get_running_loop()
    with suppress(OSError):
        while not is_gone(connection):
            with suppress(TimeoutError):
                async with asyncio.timeout(_LOOK_S):
                    # Reading available data does not yield to the event loop, but other tasks need their turn.
                    while await loop.sock_recv(connection, 1024):  # noqa: ASYNC110
                        await asyncio.sleep(0)
                    return
