"""Feeds parsers: a subscriber's connection as a socket does, at most as much at once as its buffer takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gateway.ros1.errors import Ros1Error
from gateway.ros1.wire.xmlrpc import DEFAULT_MAX_BODY_BYTES, Decoder

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gateway.ros1.wire.tcpros import SubscriberConnection, SubscriberEvent
    from gateway.ros1.wire.xmlrpc import Body


def events_of(connection: SubscriberConnection, *pieces: bytes) -> list[SubscriberEvent]:
    """Return the events of the pieces, fed one after the other; raises what the connection raises."""
    return list(_fed(connection, pieces))


def outcome_of(connection: SubscriberConnection, *pieces: bytes) -> tuple[list[SubscriberEvent], str]:
    """Return the events, and the error after them."""
    events: list[SubscriberEvent] = []
    try:
        events.extend(_fed(connection, pieces))
    except Ros1Error as error:
        return events, repr(error)
    return events, ""


def _fed(connection: SubscriberConnection, pieces: tuple[bytes, ...]) -> Iterator[SubscriberEvent]:
    for piece in pieces:
        rest = memoryview(piece)
        while rest:
            buffer = connection.get_buffer()
            count = min(len(buffer), len(rest))
            buffer[:count] = rest[:count]
            rest = rest[count:]
            connection.buffer_updated(count)
            while (event := connection.next_event()) is not None:
                yield event


def decode(data: bytes, max_bytes: int = DEFAULT_MAX_BODY_BYTES) -> Body:
    """Return what a whole XML-RPC body says."""
    decoder = Decoder(max_bytes)
    decoder.feed(data)
    return decoder.close()
