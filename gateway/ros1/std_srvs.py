"""The services of std_srvs: Empty, Trigger and SetBool."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from gateway.ros1.errors import MessageError
from gateway.ros1.messages import deserialise, new_message, serialise, service_type
from gateway.ros1.wire.tcpros import TopicType


def _type(name: str) -> TopicType:
    return TopicType(name, service_type(name).md5sum)


EMPTY: Final = _type("std_srvs/Empty")
TRIGGER: Final = _type("std_srvs/Trigger")
SET_BOOL: Final = _type("std_srvs/SetBool")
ALL: Final = (EMPTY, TRIGGER, SET_BOOL)


@dataclass(frozen=True, slots=True)
class Answer:
    """What a Trigger or a SetBool answers."""

    success: bool
    message: str


def serialise_request(kind: TopicType, *, argument: bool | None) -> bytes:
    """Return the request of a service of std_srvs.

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
    """Return what a service of std_srvs answered; an Empty answers nothing.

    Raises:
        MessageError: the bytes are not such a response.

    """
    found: Any = deserialise(service_type(kind.name).response.name, data)
    return None if kind == EMPTY else Answer(found.success, found.message)
