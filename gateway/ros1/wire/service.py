"""One call of a ROS service without I/O: the caller's side.

A connection object belongs to one socket and is never used for a second one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from gateway.ros1.errors import TcprosError
from gateway.ros1.wire.header import LENGTH, MAX_HEADER_BYTES, decode_header, encode_header
from gateway.ros1.wire.tcpros import ANY, TopicType, checked_type, message_prefix
from gateway.ros1.wire.text import one_line

if TYPE_CHECKING:
    from collections.abc import Mapping

DEFAULT_MAX_RESPONSE_BYTES = 8 << 20
MAX_REASON_BYTES = 64 << 10


@dataclass(frozen=True, slots=True)
class ServiceAccepted:
    """The service's header arrived and fits; it waits for the request."""

    type: TopicType


@dataclass(frozen=True, slots=True)
class ServiceAnswered:
    """The whole serialised response."""

    data: bytes


@dataclass(frozen=True, slots=True)
class ServiceFailed:
    """The service reports a failure, with the reason in one line."""

    reason: str


ServiceEvent: TypeAlias = ServiceAccepted | ServiceAnswered | ServiceFailed


class ServiceConnection:
    """Send `opening`; on ServiceAccepted send `request`; one more event ends the call. Later bytes are ignored.

    An error ends the connection. Holds at most what was received of one frame, and no frame over its limit.
    """

    def __init__(
        self, *, callerid: str, service: str, expected: TopicType, max_response_bytes: int = DEFAULT_MAX_RESPONSE_BYTES
    ) -> None:
        fields = {"callerid": callerid, "service": service, "md5sum": expected.md5sum, "tcp_nodelay": "1"}
        if expected.name != ANY:
            fields["type"] = expected.name
        self.opening = encode_header(fields)
        self._service = service
        self._expected = expected
        self._max_response_bytes = max_response_bytes
        self._received = bytearray()
        self._accepted = False
        self._ended = False

    @staticmethod
    def request(data: bytes) -> bytes:
        """Return a serialised request with its length prefix.

        Raises:
            TcprosError: a length prefix cannot say how long it is.

        """
        return message_prefix(len(data)) + data

    def receive_data(self, data: bytes | bytearray | memoryview) -> None:
        """Take received bytes; then call `next_event` until it returns None."""
        if not self._ended:
            self._received += data

    def next_event(self) -> ServiceEvent | None:
        """Return the next event, or None if more bytes are needed or the call has ended.

        Raises:
            HeaderError, TcprosError: the peer does not speak TCPROS, or a limit is passed.
            LinkRefusedError: the service answered `error=`.
            TypeMismatchError: the service's type or md5sum is not the expected one.

        """
        if self._ended:
            return None
        if self._accepted:
            return self._answer()
        body = self._frame(0, MAX_HEADER_BYTES)
        if body is None:
            return None
        event = self._accept(decode_header(body))
        self._accepted = True
        return event

    def _accept(self, fields: Mapping[str, str]) -> ServiceAccepted:
        return ServiceAccepted(checked_type(fields, "service", self._service, self._expected))

    def _answer(self) -> ServiceEvent | None:
        if not self._received:
            return None
        succeeded = self._received[0] != 0
        body = self._frame(1, self._max_response_bytes if succeeded else MAX_REASON_BYTES)
        if body is None:
            return None
        self._ended = True
        self._received.clear()
        return ServiceAnswered(body) if succeeded else ServiceFailed(one_line(body.decode(errors="replace")))

    def _frame(self, start: int, limit: int) -> bytes | None:
        """Remove and return the complete frame whose length is at `start`, with the bytes before it."""
        begin = start + LENGTH.size
        if len(self._received) < begin:
            return None
        (length,) = LENGTH.unpack_from(self._received, start)
        if length > limit:
            raise TcprosError(f"frame of {length} bytes, over the limit of {limit}")
        if len(self._received) < begin + length:
            return None
        body = bytes(memoryview(self._received)[begin : begin + length])
        del self._received[: begin + length]
        return body
