"""Whatever arrives on the bus, decoding raises SchemaError and nothing else."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas import codec
from schemas.codec import Message
from schemas.errors import SchemaError
from tests.schemas.test_codec import MESSAGES

SCHEMAS = list(codec.MAX_BYTES)
scalars = st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary()
values = st.recursive(scalars, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=20)


def decode(schema: type[Message], payload: bytes) -> None:
    try:
        message = codec.decode(schema, payload, codec.encoding(schema))
    except SchemaError:
        return
    again = codec.encode(message)  # bytes are compared, for NaN is not equal to itself
    assert codec.encode(codec.decode(schema, again, codec.encoding(schema))) == again


@pytest.mark.parametrize("schema", SCHEMAS)
@given(payload=st.binary(max_size=300))
def test_arbitrary_bytes(schema: type[Message], payload: bytes) -> None:
    decode(schema, payload)


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
@given(data=st.data())
def test_valid_messages_with_bytes_changed_cut_or_added(message: Message, data: st.DataObject) -> None:
    payload = bytearray(codec.encode(message))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(payload) - 1))
        payload[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
        if not payload:
            break
    decode(type(message), bytes(payload))


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
@given(data=st.data())
def test_valid_messages_with_a_field_of_another_value(message: Message, data: st.DataObject) -> None:
    fields = msgspec.to_builtins(message, builtin_types=(memoryview,))
    fields[data.draw(st.sampled_from(sorted(fields)))] = data.draw(values)
    decode(type(message), msgspec.msgpack.encode(fields))
