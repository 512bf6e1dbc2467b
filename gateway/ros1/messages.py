"""Message and service types by their ROS 1 name (`sensor_msgs/Image`): definition, md5sum, bytes to object and back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from gateway.ros1.errors import InvalidNameError, MessageError, UnknownTypeError
from gateway.ros1.msg.codec import NOT_SUCH_A_MESSAGE, Codec, Duration, Time, compiled
from gateway.ros1.msg.definition import md5sum, whole_text
from gateway.ros1.msg.known_messages import DEFINITIONS, REQUEST, RESPONSE, SERVICES
from gateway.ros1.names import validate_type
from gateway.ros1.wire.tcpros import ANY, PublisherAccepted, TopicType

__all__ = [
    "ANY_TYPE",
    "Duration",
    "MessageType",
    "ServiceType",
    "Time",
    "definition_of",
    "deserialise",
    "message_type",
    "new_message",
    "serialise",
    "service_type",
]


@dataclass(frozen=True, slots=True)
class MessageType:
    """A message type; the definition includes its dependencies."""

    name: str
    md5sum: str
    definition: str

    @property
    def topic_type(self) -> TopicType:
        return TopicType(self.name, self.md5sum)


@dataclass(frozen=True, slots=True)
class ServiceType:
    """A service type; request and response are message types of their own names."""

    name: str
    md5sum: str
    request: MessageType
    response: MessageType


ANY_TYPE: Final = MessageType(ANY, ANY, "")


@cache
def message_type(name: str) -> MessageType:
    """Return a message type, or `ANY_TYPE` for `*`.

    Raises:
        UnknownTypeError: no such type.

    """
    if name == ANY:
        return ANY_TYPE
    _check_known(name, name in DEFINITIONS)
    return MessageType(name, md5sum(DEFINITIONS, name), whole_text(DEFINITIONS, name))


def definition_of(publisher: PublisherAccepted) -> str:
    """Return the full definition of a publisher's type: its own or, if it sends none, the one known here."""
    if publisher.definition or publisher.type.name == ANY:
        return publisher.definition
    try:
        known = message_type(publisher.type.name)
    except UnknownTypeError:
        return ""
    return known.definition if known.md5sum == publisher.type.md5sum else ""


@cache
def service_type(name: str) -> ServiceType:
    """Return a service type.

    Raises:
        UnknownTypeError: no such type.

    """
    _check_known(name, name in SERVICES)
    request, response = name + REQUEST, name + RESPONSE
    return ServiceType(name, md5sum(DEFINITIONS, request, response), message_type(request), message_type(response))


def _check_known(name: str, known: bool) -> None:  # noqa: FBT001 - what it checks
    try:
        validate_type(name)
    except InvalidNameError as error:
        raise UnknownTypeError(str(error)) from error
    if not known:
        raise UnknownTypeError(f"no definition of the type {name}")


@cache
def _codec(name: str) -> Codec:
    return compiled(DEFINITIONS, message_type(name).name)


def new_message(name: str, /, **fields: Any) -> Any:
    """Return a message object; all fields of its type must be given.

    Raises:
        UnknownTypeError: no such type.
        MessageError: a field is missing or not the type's.

    """
    try:
        return _codec(name).make(**fields)
    except TypeError as error:
        raise MessageError(f"{name}: {error}") from error


def serialise(name: str, message: Any) -> bytes:
    """Return the bytes of a message object.

    Raises:
        UnknownTypeError: no such type.
        MessageError: a field's value does not fit its type.

    """
    write = _codec(name).write
    try:
        return write(message)
    except (MessageError, *NOT_SUCH_A_MESSAGE) as error:
        raise MessageError(f"cannot serialise a {name}: {error}") from error


def deserialise(name: str, data: bytes | bytearray | memoryview) -> Any:
    """Return the message object of serialised bytes; its numeric arrays are views of them.

    Raises:
        UnknownTypeError: no such type.
        MessageError: the bytes are not such a message.

    """
    read = _codec(name).read
    try:
        return read(data)
    except (MessageError, *NOT_SUCH_A_MESSAGE) as error:
        raise MessageError(f"{len(data)} bytes are not a {name}: {error}") from error
