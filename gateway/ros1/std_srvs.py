"""The services of std_srvs: Empty, Trigger and SetBool."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from hashlib import md5
from typing import Final

from gateway.ros1.errors import MessageError
from gateway.ros1.wire.tcpros import TopicType

_ANSWER: Final = "bool success\nstring message"
_HEAD: Final = struct.Struct("<?I")


def _type(name: str, request: str, response: str) -> TopicType:
    """Return a type; its md5sum is that of the two texts, one after the other."""
    return TopicType(name, md5((request + response).encode(), usedforsecurity=False).hexdigest())


EMPTY: Final = _type("std_srvs/Empty", "", "")
TRIGGER: Final = _type("std_srvs/Trigger", "", _ANSWER)
SET_BOOL: Final = _type("std_srvs/SetBool", "bool data", _ANSWER)
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
        return bytes([argument])
    if argument is not None:
        raise MessageError(f"{kind.name} takes no argument")
    return b""


def deserialise_response(kind: TopicType, data: bytes) -> Answer | None:
    """Return what a service of std_srvs answered; an Empty answers nothing.

    Raises:
        MessageError: the bytes are not such a response.

    """
    if kind == EMPTY and not data:
        return None
    if kind == EMPTY or len(data) < _HEAD.size:
        raise MessageError(f"{len(data)} bytes are not a response of {kind.name}")
    success, length = _HEAD.unpack_from(data)
    if len(data) != _HEAD.size + length:
        raise MessageError(f"{len(data)} bytes are not a response of {kind.name}")
    return Answer(success, data[_HEAD.size :].decode(errors="replace"))
