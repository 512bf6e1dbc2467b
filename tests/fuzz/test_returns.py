"""Whatever arrives under a result's key, ROS gets a list that Python can parse, or the result counts as malformed."""

import ast

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from gateway.outgoing.stream import MALFORMED, StreamReturn
from gateway.outgoing.translators import CLASSES, STRING
from gateway.ros1.messages import deserialise
from schemas import codec
from schemas.detections import ClassList
from schemas.keys import CameraKey
from tests.gateway.outgoing.lists import class_list

counts = st.lists(st.tuples(st.text(max_size=300), st.integers(-1, 3) | st.integers(0, 2**64 - 1)), max_size=5)


def take(payload: bytes) -> None:
    stream = StreamReturn(CameraKey("r1", "front"), "/ultralytics", CLASSES)
    message = stream.take(payload, codec.encoding(ClassList), 0)
    status = stream.status(wanted=True, subscribers=1, slow=0)
    if message is None:
        assert (status.published, status.dropped) == (0, {MALFORMED: 1})
    else:
        assert (status.published, status.dropped) == (1, {})
        assert all(isinstance(name, str) for name in ast.literal_eval(deserialise(STRING, message).data))


@given(st.binary(max_size=300))
def test_arbitrary_bytes(payload: bytes) -> None:
    take(payload)


@given(counts)
def test_lists_of_any_names_and_counts(counted: list[tuple[str, int]]) -> None:
    take(msgspec.msgpack.encode(class_list(*counted)))


@given(counts, st.data())
def test_lists_with_bytes_changed_or_cut(counted: list[tuple[str, int]], data: st.DataObject) -> None:
    payload = bytearray(msgspec.msgpack.encode(class_list(*counted)))
    payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    take(bytes(payload[: data.draw(st.integers(0, len(payload)))]))
