"""Messages of any type, as hypothesis makes them: plain values first, so that other libraries can be given the same."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from hypothesis import strategies as st

from gateway.ros1.msg.codec import Duration, Time, message_class
from gateway.ros1.msg.definition import MOMENTS, NUMBERS, STRING, parse

if TYPE_CHECKING:
    from gateway.ros1.msg.definition import Definitions, Field

MAX_ITEMS = 4
_SIGNED, _UNSIGNED, _NANOSECONDS = (
    st.integers(-(2**31), 2**31 - 1),
    st.integers(0, 2**31 - 1),
    st.integers(0, 10**9 - 1),
)


def number(kind: str) -> st.SearchStrategy[Any]:
    """Values that a built-in number type carries exactly."""
    if kind == "bool":
        return st.booleans()
    bits = 8 * struct.calcsize("<" + NUMBERS[kind])
    if kind.startswith("float"):
        return st.floats(width=64 if bits == 64 else 32, allow_nan=False)
    if NUMBERS[kind].isupper():
        return st.integers(0, 2**bits - 1)
    return st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def plain(definitions: Definitions, kind: str) -> st.SearchStrategy[Any]:
    """Values of any type: a message is a dict of its fields, a moment a pair."""
    if kind in NUMBERS:
        return number(kind)
    if kind == STRING:
        return st.text(max_size=8)
    if kind in MOMENTS:  # what peers leave as it is: rosbags gives a time's seconds a sign, genpy carries seconds over
        return st.tuples(_UNSIGNED if kind == "time" else _SIGNED, _NANOSECONDS)
    return st.fixed_dictionaries({field.name: _field(definitions, field) for field in definitions[kind].fields})


def _field(definitions: Definitions, field: Field) -> st.SearchStrategy[Any]:
    single = plain(definitions, field.type)
    if not field.is_array:
        return single
    low, high = (0, MAX_ITEMS) if field.length is None else (field.length, field.length)
    return st.lists(single, min_size=low, max_size=high)


def built(definitions: Definitions, kind: str, value: Any) -> Any:
    """Return a plain value as this package's object."""
    if kind in MOMENTS:
        return (Time if kind == "time" else Duration)(*value)
    if "/" not in kind:
        return value
    fields = {
        field.name: [built(definitions, field.type, item) for item in value[field.name]]
        if field.is_array
        else built(definitions, field.type, value[field.name])
        for field in definitions[kind].fields
    }
    return message_class(definitions[kind])(**fields)


def taken_apart(definitions: Definitions, kind: str, value: Any) -> Any:
    """Return this package's object, or an array of numbers, as a plain value."""
    if kind in MOMENTS:
        return (value.sec, value.nanosec)
    if "/" not in kind:
        return value
    return {field.name: _apart(definitions, field, getattr(value, field.name)) for field in definitions[kind].fields}


def _apart(definitions: Definitions, field: Field, value: Any) -> Any:
    if not field.is_array:
        return taken_apart(definitions, field.type, value)
    if field.type in NUMBERS:
        return value.tolist()
    return [taken_apart(definitions, field.type, item) for item in value]


def meaning(name: str, whole: str) -> dict[str, tuple[Any, Any]]:
    """Return fields and constants of each type in a whole definition, which is that of `name` first."""
    named = (part.partition("\n") for part in f"MSG: {name}\n{whole}".split("=" * 80 + "\n"))
    parsed = [parse(head.removeprefix("MSG: "), text) for head, _, text in named]
    return {each.name: (each.fields, each.constants) for each in parsed}
