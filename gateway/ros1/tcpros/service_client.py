"""Calls ROS services, each with a deadline and on a connection of its own."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from gateway.ros1.addresses import parse_rosrpc
from gateway.ros1.errors import (
    InvalidNameError,
    MessageError,
    ServiceError,
    ServiceFailedError,
    ServiceTimeoutError,
    StatusError,
    TcprosError,
    UnknownServiceError,
    UnreachableError,
)
from gateway.ros1.messages import deserialise, new_message, serialise, service_type
from gateway.ros1.names import validate_global
from gateway.ros1.tcpros.keepalive import notice_dead_peer
from gateway.ros1.wire.service import (
    DEFAULT_MAX_RESPONSE_BYTES,
    ServiceAccepted,
    ServiceAnswered,
    ServiceConnection,
    ServiceFailed,
)
from gateway.ros1.wire.tcpros import TopicType

if TYPE_CHECKING:
    from collections.abc import Callable

    from gateway.ros1.master import MasterClient
    from gateway.ros1.wire.tcpros import TopicType


_CHUNK_BYTES = 64 << 10


@dataclass(frozen=True, slots=True)
class ServiceAnswer:
    """A service's type from its header, and its serialised response."""

    type: TopicType
    data: bytes


class ServiceClient:
    """Calls services that one master knows, on behalf of one node."""

    def __init__(self, master: MasterClient, *, max_response_bytes: int = DEFAULT_MAX_RESPONSE_BYTES) -> None:
        self._master = master
        self._max_response_bytes = max_response_bytes

    async def call(
        self, service: str, expected: TopicType, make_request: Callable[[TopicType], bytes], *, timeout_s: float
    ) -> ServiceAnswer:
        """Call a service by its global name; `*` in `expected` accepts any type.

        `make_request` is given the service's type and returns the serialised request; its exceptions end the call
        before the service is asked for anything.

        Raises:
            InvalidNameError: the name.
            UnknownServiceError: the master knows no such service.
            UnreachableError: the master or the service cannot be reached, or its connection broke.
            ServiceTimeoutError: no answer within `timeout_s` seconds.
            ServiceFailedError: the service says so; the text is its own.
            LinkRefusedError, TypeMismatchError: the service refuses the call, or has another type.
            WireError: the other side speaks no TCPROS.

        """
        connection = ServiceConnection(
            callerid=self._master.caller_id,
            service=validate_global(service),
            expected=expected,
            max_response_bytes=self._max_response_bytes,
        )
        try:
            async with asyncio.timeout(timeout_s):
                host, port = await self._lookup(service)
                return await self._call(service, host, port, connection, make_request)
        except TimeoutError as error:
            raise ServiceTimeoutError(f"{service} did not answer within {timeout_s:g} s") from error
        except (OSError, UnicodeError) as error:  # UnicodeError: not a possible host name
            raise UnreachableError(f"{service} cannot be reached: {error}") from error

    async def _lookup(self, service: str) -> tuple[str, int]:
        try:
            return parse_rosrpc(await self._master.lookup_service(service))
        except StatusError as error:
            raise UnknownServiceError(f"the ROS master knows no service {service}") from error
        except InvalidNameError as error:
            raise UnreachableError(f"{service}: {error}") from error

    async def _call(
        self,
        service: str,
        host: str,
        port: int,
        connection: ServiceConnection,
        make_request: Callable[[TopicType], bytes],
    ) -> ServiceAnswer:
        connect = self._master.resolver.connect
        reader, writer = await connect(host, lambda found: asyncio.open_connection(found, port))
        try:
            notice_dead_peer(writer.get_extra_info("socket"))
            writer.write(connection.opening)
            accepted = await _next(service, reader, connection)
            if not isinstance(accepted, ServiceAccepted):
                raise TcprosError(f"{service} answered before it was asked")
            writer.write(connection.request(make_request(accepted.type)))
            answered = await _next(service, reader, connection)
        finally:
            writer.transport.abort()
        match answered:
            case ServiceAnswered(data):
                return ServiceAnswer(accepted.type, data)
            case ServiceFailed(reason):
                raise ServiceFailedError(f"{service} failed: {reason or 'it does not say why'}")
            case ServiceAccepted():
                raise ServiceError(f"{service} did not answer")


async def _next(
    service: str, reader: asyncio.StreamReader, connection: ServiceConnection
) -> ServiceAccepted | ServiceAnswered | ServiceFailed:
    while (event := connection.next_event()) is None:
        data = await reader.read(_CHUNK_BYTES)
        if not data:
            raise UnreachableError(f"{service} closed the connection without an answer")
        connection.receive_data(data)
    return event


def _type(name: str) -> TopicType:
    return TopicType(name, service_type(name).md5sum)


EMPTY: Final = _type("std_srvs/Empty")
TRIGGER: Final = _type("std_srvs/Trigger")
SET_BOOL: Final = _type("std_srvs/SetBool")
ALL: Final = (EMPTY, TRIGGER, SET_BOOL)


@dataclass(frozen=True, slots=True)
class Answer:
    """Response of a std_srvs/Trigger or std_srvs/SetBool."""

    success: bool
    message: str


def serialise_request(kind: TopicType, *, argument: bool | None) -> bytes:
    """Return the serialised request for a service of std_srvs.

    Raises:
        MessageError: a SetBool without an argument, or another one with.

    """
    if kind == SET_BOOL:
        if argument is None:
            raise MessageError(f"{kind.name} needs to be told true or false")
        request = service_type(kind.name).request.name
        return serialise(request, new_message(request, data=argument))
    if argument is not None:
        raise MessageError(f"{kind.name} takes no argument")
    return b""


def deserialise_response(kind: TopicType, data: bytes) -> Answer | None:
    """Return the response of a service of std_srvs; None for an Empty.

    Raises:
        MessageError: the bytes are not such a response.

    """
    found: Any = deserialise(service_type(kind.name).response.name, data)
    return None if kind == EMPTY else Answer(found.success, found.message)
