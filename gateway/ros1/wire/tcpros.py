"""TCPROS without I/O: the subscriber's and the publisher's side of one topic connection.

A connection object belongs to one socket and is never used for a second one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from gateway.ros1.errors import LinkRefusedError, TcprosError, TypeMismatchError
from gateway.ros1.wire.framing import FrameReceiver
from gateway.ros1.wire.header import LENGTH, MAX_HEADER_BYTES, decode_header, encode_header
from gateway.ros1.wire.text import one_line

if TYPE_CHECKING:
    from collections.abc import Mapping

    from gateway.ros1.wire.framing import FrameBudget

ANY = "*"
DEFAULT_MAX_MESSAGE_BYTES = 128 << 20


class TopicType(NamedTuple):
    """A message type as two peers compare it; `*` stands for any."""

    name: str
    md5sum: str


@dataclass(frozen=True, slots=True)
class Offer:
    """A publisher's description of its topic."""

    topic: str
    type: TopicType
    definition: str
    latching: bool = False


@dataclass(frozen=True, slots=True)
class PublisherAccepted:
    """The publisher's header arrived and fits; messages follow."""

    callerid: str
    type: TopicType
    definition: str
    latching: bool


class MessageReceived(NamedTuple):
    """One whole serialised message, in memory of its own."""

    data: memoryview


@dataclass(frozen=True, slots=True)
class SubscriberAccepted:
    """A subscriber's header arrived and fits one of the offers; `reply` is to be sent before any message."""

    callerid: str
    topic: str
    tcp_nodelay: bool
    reply: bytes


@dataclass(frozen=True, slots=True)
class SubscriberRefused:
    """A subscriber's header does not fit: send `reply`, then close."""

    reason: str
    reply: bytes


SubscriberEvent: TypeAlias = PublisherAccepted | MessageReceived
PublisherEvent: TypeAlias = SubscriberAccepted | SubscriberRefused


class SubscriberConnection:
    """The subscriber's side: send `opening`, receive into `get_buffer`, call `next_event` until it returns None.

    An error ends the connection; the events before it have been given by then, however the stream is cut.

    get_buffer: returns where the next received bytes belong; never empty once `next_event` has returned None.
    buffer_updated: takes so many bytes written to the start of the last `get_buffer`.
    """

    def __init__(
        self,
        *,
        callerid: str,
        topic: str,
        expected: TopicType,
        max_message_bytes: int = DEFAULT_MAX_MESSAGE_BYTES,
        budget: FrameBudget | None = None,
    ) -> None:
        self.opening = encode_header(
            {
                "callerid": callerid,
                "topic": topic,
                "md5sum": expected.md5sum,
                "type": expected.name,
                "tcp_nodelay": "1",
            }
        )
        self._topic = topic
        self._expected = expected
        self._max_message_bytes = max_message_bytes
        self._accepted = False
        self._frames = FrameReceiver(MAX_HEADER_BYTES, budget)
        self.get_buffer = self._frames.get_buffer
        self.buffer_updated = self._frames.buffer_updated

    @property
    def message_under_way(self) -> int | None:
        """The number of the message that is partly received."""
        return self._frames.frame_under_way

    def close(self) -> None:
        """Release the received data; the connection has ended."""
        self._frames.close()

    def next_event(self) -> SubscriberEvent | None:
        """Return the next event, or None if more bytes are needed.

        Raises:
            HeaderError, TcprosError: the publisher does not speak TCPROS, or a limit is passed.
            TooLargeError: a message is over `max_message_bytes`.
            LinkRefusedError: the publisher answered `error=`.
            TypeMismatchError: the publisher's type or md5sum is not the expected one.

        """
        frame = self._frames.next_frame()
        if frame is None:
            return None
        if self._accepted:
            return MessageReceived(frame)
        event = self._accept(decode_header(frame))
        self._accepted = True
        self._frames.max_frame_bytes = self._max_message_bytes
        self._frames.of_messages = True
        return event

    def _accept(self, fields: Mapping[str, str]) -> PublisherAccepted:
        found = checked_type(fields, "publisher", self._topic, self._expected)
        return PublisherAccepted(
            callerid=one_line(fields.get("callerid", "")),
            type=found,
            definition=fields.get("message_definition", ""),
            latching=fields.get("latching") == "1",
        )


def checked_type(fields: Mapping[str, str], sender: str, subject: str, expected: TopicType) -> TopicType:
    """Return the type in a peer's header if it fits ours. sender, subject: their names in errors.

    Raises:
        LinkRefusedError: the header says `error=`.
        TcprosError: it does not say its type.
        TypeMismatchError: that is not the expected one.

    """
    if "error" in fields:
        raise LinkRefusedError(one_line(fields["error"]))
    if missing := [key for key in ("type", "md5sum") if key not in fields]:
        raise TcprosError(f"{sender}'s header lacks {' and '.join(missing)}")
    found = TopicType(fields["type"], fields["md5sum"])
    if not _fits(expected, found):
        raise TypeMismatchError(
            f"{subject} is {one_line(found.name)} [{one_line(found.md5sum)}], "
            f"expected {expected.name} [{expected.md5sum}]"
        )
    return found


def _fits(expected: TopicType, found: TopicType) -> bool:
    concrete = ANY not in (found.name, found.md5sum)
    return concrete and expected.name in (ANY, found.name) and expected.md5sum in (ANY, found.md5sum)


class PublisherConnection:
    """The publisher's side: feed received bytes until one event comes; later bytes are ignored."""

    def __init__(self, *, callerid: str, offers: Mapping[str, Offer], budget: FrameBudget | None = None) -> None:
        self._callerid = callerid
        self._offers = offers
        self._answered = False
        self._frames = FrameReceiver(MAX_HEADER_BYTES, budget)

    def close(self) -> None:
        """Release the received data; the connection has ended, or its header has come."""
        self._frames.close()

    def receive_data(self, data: bytes) -> PublisherEvent | None:
        """Take received bytes.

        Raises:
            HeaderError, TcprosError: the subscriber does not speak TCPROS, or a limit is passed.

        """
        rest = memoryview(data)
        while rest and not self._answered:
            buffer = self._frames.get_buffer()
            count = min(len(buffer), len(rest))
            buffer[:count] = rest[:count]
            rest = rest[count:]
            self._frames.buffer_updated(count)
            frame = self._frames.next_frame()
            if frame is not None:
                self._answered = True
                return self._answer(decode_header(frame))
        return None

    def _answer(self, fields: Mapping[str, str]) -> PublisherEvent:
        reason = self._objection(fields)
        if reason is not None:
            return SubscriberRefused(reason, encode_header({"error": reason}))
        offer = self._offers[fields["topic"]]
        reply = encode_header(
            {
                "callerid": self._callerid,
                "topic": offer.topic,
                "type": offer.type.name,
                "md5sum": offer.type.md5sum,
                "message_definition": offer.definition,
                "latching": "1" if offer.latching else "0",
            }
        )
        callerid = one_line(fields["callerid"])
        return SubscriberAccepted(callerid, offer.topic, fields.get("tcp_nodelay") == "1", reply)

    def _objection(self, fields: Mapping[str, str]) -> str | None:
        if "service" in fields:
            return f"{self._callerid} offers no services"
        if missing := [key for key in ("topic", "md5sum", "callerid") if key not in fields]:
            return f"header lacks {' and '.join(missing)}"
        offer = self._offers.get(fields["topic"])
        if offer is None:
            return f"{self._callerid} does not publish {fields['topic'][:200]}"
        wanted = TopicType(fields.get("type", ANY), fields["md5sum"])
        if not _fits(wanted, offer.type):
            return f"{offer.topic} is {offer.type.name} [{offer.type.md5sum}]"
        return None


def message_prefix(size: int) -> bytes:
    """Return the length prefix of a message of `size` bytes.

    Raises:
        TcprosError: a length prefix cannot say that many.

    """
    if size > 0xFFFFFFFF:
        raise TcprosError(f"message of {size} bytes does not fit a 4-byte length")
    return LENGTH.pack(size)
