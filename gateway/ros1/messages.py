"""Message types by their ROS 1 name (`sensor_msgs/Image`): definition, md5sum, bytes to object and back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gateway.ros1.errors import InvalidNameError, MessageError, UnknownTypeError
from gateway.ros1.names import validate_type
from gateway.ros1.wire.tcpros import ANY, TopicType

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

# Of ROS 1's common types, those that rosbags does not have.
_FURTHER_TYPES = {"tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms"}


@dataclass(frozen=True, slots=True)
class MessageType:
    """A message type; the definition is whole, that of its dependencies included."""

    name: str
    md5sum: str
    definition: str

    @property
    def topic_type(self) -> TopicType:
        return TopicType(self.name, self.md5sum)


ANY_TYPE = MessageType(ANY, ANY, "")


@cache
def _store() -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC)
    for name, definition in _FURTHER_TYPES.items():
        store.register(get_types_from_msg(definition, _spelt(name)))
    return store


def _spelt(name: str) -> str:
    """Return a legal type name as rosbags spells it."""
    package, _, short = name.partition("/")
    return f"{package}/msg/{short}"


def _internal(name: str) -> str:
    try:
        internal = _spelt(validate_type(name))
    except InvalidNameError as error:
        raise UnknownTypeError(str(error)) from error
    if internal not in _store().types:
        raise UnknownTypeError(f"no definition of the message type {name}")
    return internal


@cache
def message_type(name: str) -> MessageType:
    """Return a type of ROS 1 Noetic's common packages, or `ANY_TYPE` for `*`.

    Raises:
        UnknownTypeError: no such type.

    """
    if name == ANY:
        return ANY_TYPE
    definition, md5sum = _store().generate_msgdef(_internal(name), ros_version=1)
    return MessageType(name, md5sum, definition)


def new_message(name: str, /, **fields: Any) -> Any:
    """Return a message object with all fields of its type given.

    Raises:
        UnknownTypeError: no such type.
        MessageError: a field is missing or not the type's.

    """
    try:
        return _store().types[_internal(name)](**fields)
    except TypeError as error:
        raise MessageError(f"{name}: {error}") from error


def serialise(name: str, message: Any) -> bytes:
    """Return the bytes of a message object.

    Raises:
        UnknownTypeError: no such type.
        MessageError: a field's value does not fit its type.

    """
    internal = _internal(name)
    try:
        return bytes(_store().serialize_ros1(message, internal))
    except Exception as error:
        raise MessageError(f"cannot serialise a {name}: {error}") from error


def deserialise(name: str, data: bytes | bytearray | memoryview) -> Any:
    """Return the message object that the bytes are; fastest from `bytes`.

    Raises:
        UnknownTypeError: no such type.
        MessageError: the bytes are not such a message.

    """
    internal = _internal(name)
    whole = data if isinstance(data, bytes) else bytes(data)
    try:
        return _store().deserialize_ros1(whole, internal)
    except Exception as error:
        raise MessageError(f"{len(whole)} bytes are not a {name}: {error!r}") from error
