"""Listens to one publisher of one topic as a subscriber would, for a bounded time; the master is told nothing of it."""

import asyncio
import time
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Final

from gateway.doctor.evidence import Heard
from gateway.doctor.reading import stamp_at, stamp_offset, translated
from gateway.ros1.link import run_link
from gateway.ros1.subscriber import Message
from gateway.ros1.wire.tcpros import (
    ANY,
    MessageReceived,
    PublisherAccepted,
    SubscriberConnection,
    SubscriberEvent,
    TopicType,
)
from schemas.keys import SensorKey

MAX_MESSAGES: Final = 200
"""How many messages of one publisher are enough."""


@dataclass(slots=True)
class Ear:
    """Takes in what one connection brings; only the first message is kept."""

    uri: str
    publisher: PublisherAccepted | None = None
    first: Message | None = None
    arrivals_s: list[float] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    lags_ns: list[int] = field(default_factory=list)
    size: int = 0
    _offset: int | None = None

    @property
    def full(self) -> bool:
        return len(self.arrivals_s) >= MAX_MESSAGES

    def accepted(self, publisher: PublisherAccepted) -> None:
        self.publisher = publisher
        self._offset = stamp_offset(publisher.definition)

    def hear(self, data: bytearray, now_s: float, now_ns: int) -> None:
        """Note a message's arrival, on a steady clock and on the system's."""
        if self.publisher is None or self.full:
            return
        self.first = self.first or Message(data, self.uri, self.publisher)
        self.arrivals_s.append(now_s)
        self.size = max(self.size, len(data))
        stamp_ns = None if self._offset is None else stamp_at(data, self._offset)
        if stamp_ns is not None:
            self.stamps_ns.append(stamp_ns)
            self.lags_ns.append(now_ns - stamp_ns)

    def heard(self, key: SensorKey, now_ns: int) -> Heard:
        """Return all of it, the first message as the stream would carry it."""
        heard = Heard(tuple(self.arrivals_s), self.size, tuple(self.stamps_ns), tuple(self.lags_ns))
        if self.first is None:
            return heard
        found = translated(key, self.first, now_ns)
        return replace(heard, unreadable=found) if isinstance(found, str) else replace(heard, message=found)


async def listen(
    address: tuple[str, int], topic: str, ear: Ear, *, callerid: str, seconds: float, patience_s: float
) -> None:
    """Listen for so many seconds after the publisher has accepted us, or until it ends the connection.

    Raises:
        Ros1Error: there is no such connection, or the publisher does not speak TCPROS.
    """
    loop = asyncio.get_running_loop()
    connection = SubscriberConnection(callerid=callerid, topic=topic, expected=TopicType(ANY, ANY))
    with suppress(TimeoutError):
        async with asyncio.timeout(2 * patience_s) as deadline:

            def take(event: SubscriberEvent) -> None:
                match event:
                    case PublisherAccepted():
                        ear.accepted(event)
                        deadline.reschedule(loop.time() + seconds)
                    case MessageReceived(data):
                        ear.hear(data, loop.time(), time.time_ns())
                        if ear.full:
                            deadline.reschedule(loop.time())

            await run_link(address, connection, take, handshake_timeout=patience_s)
