"""What a publisher's messages say, as the gateway would read them. Pure."""

import struct
from typing import Final

from gateway.ros1.errors import Ros1Error
from gateway.ros1.messages import ANY_TYPE, message_type
from gateway.ros1.subscriber import Message
from gateway.translators import Repaired, StreamKind
from schemas import codec
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.keys import SensorKey, owner_of

_TIME: Final = struct.Struct("<II")
_HEADERS: Final = frozenset({"Header", "std_msgs/Header"})
_SEQ_BYTES: Final = 4


def stamp_offset(definition: str) -> int | None:
    """Return where in a message of the defined type a time stands, or None when it does not begin with one."""
    for line in definition.splitlines():
        words = line.partition("#")[0].split()
        if line.startswith("="):
            return None
        if len(words) < 2 or "=" in line.partition("#")[0]:
            continue
        if words[0] in _HEADERS:
            return _SEQ_BYTES
        return 0 if words[0] == "time" else None
    return None


def stamp_at(data: bytes | bytearray | memoryview, offset: int) -> int | None:
    """Return the time that stands there in nanoseconds, or None when the message is too short for one."""
    if len(data) < offset + _TIME.size:
        return None
    seconds, rest = _TIME.unpack_from(data, offset)
    return int(seconds) * 1_000_000_000 + int(rest)


def translated(key: SensorKey, kind: StreamKind, message: Message, now_ns: int) -> codec.Message | str:
    """Return what the gateway would send of a message on a stream of the kind, or why it could not."""
    said = message.publisher.type
    try:
        name = said.name if said.name in kind.translators else ANY_TYPE.name
        begin = kind.translators.get(name)
        if begin is None or message_type(name).topic_type not in {said, ANY_TYPE.topic_type}:
            return ""
        if len(message.data) > kind.max_bytes:
            return f"{len(message.data)} bytes, at most {kind.max_bytes} are read"
        return begin()(message, _header(key, now_ns))
    except Repaired as error:
        return error.made
    except (Ros1Error, SchemaError) as error:
        return str(error)


def _header(key: SensorKey, now_ns: int) -> Header:
    robot, camera = owner_of(key)
    return Header(robot=robot, camera=camera, boot_id="", seq=0, stamp_ns=0, frame_id="", received_ns=now_ns)
