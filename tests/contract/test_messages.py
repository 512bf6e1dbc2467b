"""Message types as rosbags has them: md5sum, definition and bytes, both ways, of the types spoken here and of any."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gateway.ros1.msg.codec import compiled
from gateway.ros1.msg.definition import MOMENTS, NUMBERS, STRING, Definition, md5sum, parse, whole_text
from gateway.ros1.msg.known_messages import DEFINITIONS
from tests.gateway.ros1.msg.building import built, meaning, plain, taken_apart

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    from gateway.ros1.msg.definition import Definitions

BUILT_IN = (*NUMBERS, *MOMENTS, STRING)
SOME = {name: definition for name, definition in DEFINITIONS.items() if definition.fields}


def spelt(name: str) -> str:
    return name.replace("/", "/msg/")


def store_of(definitions: Definitions) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    for name, definition in definitions.items():
        store.register(get_types_from_msg(definition.text, spelt(name)))
    return store


def theirs(store: Typestore, definitions: Definitions, kind: str, value: Any) -> Any:
    """Return a plain value as an object of rosbags."""
    if kind in MOMENTS:
        return store.types[f"builtin_interfaces/msg/{kind.title()}"](*value)
    if "/" not in kind:
        return value
    fields: dict[str, Any] = {}
    for field in definitions[kind].fields:
        found = value[field.name]
        if field.is_array and field.type in NUMBERS:
            fields[field.name] = np.array(found, "<" + NUMBERS[field.type])
        elif field.is_array:
            fields[field.name] = [theirs(store, definitions, field.type, item) for item in found]
        else:
            fields[field.name] = theirs(store, definitions, field.type, found)
    return store.types[spelt(kind)](**fields)


def agree(store: Typestore, definitions: Definitions, name: str, value: Any) -> None:
    codec = compiled(definitions, name)
    data = codec.write(built(definitions, name, value))
    assert data == bytes(store.serialize_ros1(theirs(store, definitions, name, value), spelt(name)))
    assert taken_apart(definitions, name, codec.read(data)) == value
    again = store.deserialize_ros1(data, spelt(name))
    assert bytes(store.serialize_ros1(again, spelt(name))) == data


def defined_alike(store: Typestore, definitions: Definitions, name: str) -> None:
    text, md5 = store.generate_msgdef(spelt(name), ros_version=1)
    assert md5sum(definitions, name) == md5
    assert meaning(name, whole_text(definitions, name)) == meaning(name, text)


STORE = store_of(DEFINITIONS)


@pytest.mark.parametrize("name", DEFINITIONS)
def test_definition_and_md5sum_of_what_is_spoken(name: str) -> None:
    defined_alike(STORE, DEFINITIONS, name)


@pytest.mark.parametrize("name", SOME)
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_bytes_of_what_is_spoken(name: str, data: st.DataObject) -> None:
    agree(STORE, DEFINITIONS, name, data.draw(plain(DEFINITIONS, name)))


names = st.integers(0, 9).map(lambda number: f"f{number}")
arrays = st.sampled_from(["", "[]", "[2]", "[3]"])
constants = st.sampled_from(
    ["int32 N=-5", "uint8 HEX = 255 # so many", "float64 PI=3.25", "string S=  a # b = c ", "bool YES=True"]
)


@st.composite
def definitions_of_any(draw: st.DrawFn) -> Definitions:
    """Three types of two packages, the later ones made of the earlier ones too; the last one is `b/C`."""
    found: dict[str, Definition] = {}
    for name in ("a/A", "a/B", "b/C"):
        kinds = st.sampled_from([*BUILT_IN, *found])
        drawn = draw(st.dictionaries(names, st.tuples(kinds, arrays), min_size=1, max_size=5))
        lines = [f"{kind}{array} {field}  # what it is" for field, (kind, array) in drawn.items()]
        extra = draw(st.lists(constants, max_size=2, unique_by=lambda line: line.split()[1]))
        found[name] = parse(name, "\n".join(draw(st.permutations([*lines, *extra, "# a = 1", ""]))))
    return found


@settings(max_examples=20, deadline=None)
@given(definitions=definitions_of_any(), data=st.data())
def test_any_definition(definitions: Definitions, data: st.DataObject) -> None:
    store = store_of(definitions)
    for name in definitions:
        defined_alike(store, definitions, name)
    agree(store, definitions, "b/C", data.draw(plain(definitions, "b/C")))
