"""Compiles definitions to functions that read and write messages."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np

from gateway.ros1.errors import MessageError
from gateway.ros1.msg.source import Reading, Writing

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from typing import TypeAlias

    from gateway.ros1.msg.definition import Definition, Definitions

    Buffer: TypeAlias = bytes | bytearray | memoryview

NOT_SUCH_A_MESSAGE: Final = (struct.error, ValueError, TypeError, AttributeError, OverflowError)
"""Exceptions of reading and writing besides MessageError."""


class Time(msgspec.Struct, frozen=True):
    """A point in time; both parts are unsigned on the wire."""

    sec: int
    nanosec: int


class Duration(msgspec.Struct, frozen=True):
    """A span of time; both parts are signed on the wire."""

    sec: int
    nanosec: int


@dataclass(frozen=True, slots=True)
class Codec:
    """One message type's class and functions.

    Arrays of numbers are read as numpy views of the bytes, and written from such arrays, from bytes where an item is
    one, or from any sequence; arrays of anything else are lists.
    """

    make: type[msgspec.Struct]
    read: Callable[[Buffer], Any]
    write: Callable[[Any], bytes]


def compiled(definitions: Definitions, name: str) -> Codec:
    """Return the codec of a message type.

    Raises:
        KeyError: the type, or one that it needs, has no definition.
        MessageError: it has an array of messages without fields.

    """
    kinds = {each.name: message_class(each) for each in _with_needed(definitions, name)}
    return Codec(
        kinds[name], _function(Reading(definitions), name, kinds), _function(Writing(definitions), name, kinds)
    )


def _function(source: Reading | Writing, name: str, kinds: dict[str, type[msgspec.Struct]]) -> Any:
    text = source.function(name)
    namespace: dict[str, Any] = {
        "make": kinds,
        "time": Time,
        "duration": Duration,
        "frombuffer": np.frombuffer,
        "packed": _packed,
        "counted": _counted,
        "MessageError": MessageError,
    }
    namespace |= {f"s{number}": struct.Struct(form) for number, form in enumerate(source.formats)}
    exec(compile(text, f"<{name}>", "exec"), namespace)  # noqa: S102 - as namedtuple does; parsed names, nothing else
    return namespace["read" if isinstance(source, Reading) else "write"]


def _with_needed(definitions: Definitions, name: str) -> Iterator[Definition]:
    yield definitions[name]
    for field in definitions[name].fields:
        if field.is_message:
            yield from _with_needed(definitions, field.type)


@cache
def message_class(definition: Definition) -> type[msgspec.Struct]:
    """Return the class of a type's messages, alone and nested."""
    return msgspec.defstruct(definition.name.partition("/")[2], [(field.name, Any) for field in definition.fields])


def _packed(value: Any, kind: str, length: int | None) -> Any:
    """Return an array of numbers as a buffer that can be joined and has `nbytes`."""
    if isinstance(value, np.ndarray):
        if value.dtype != kind:
            raise MessageError(f"array of {value.dtype} instead of {np.dtype(kind)}")
        packed: Any = np.ascontiguousarray(value).reshape(-1)
    elif isinstance(value, bytes | bytearray | memoryview) and kind == "<B":
        packed = memoryview(value)
    else:
        packed = memoryview(struct.pack(f"<{len(value)}{kind[1:]}", *value))
    if length is not None and packed.nbytes != length * struct.calcsize(kind):
        raise MessageError(f"array of {packed.nbytes} bytes instead of {length} items")
    return packed


def _counted(items: Sequence[Any], length: int | None) -> Sequence[Any]:
    if length is not None and len(items) != length:
        raise MessageError(f"array of {len(items)} items instead of {length}")
    return items
