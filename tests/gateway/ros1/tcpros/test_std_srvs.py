from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.ros1.errors import MessageError
from gateway.ros1.tcpros.service_client import EMPTY, SET_BOOL, TRIGGER, Answer, deserialise_response, serialise_request
from gateway.ros1.wire.tcpros import TopicType


def test_the_types_are_those_of_debians_std_srvs() -> None:
    assert TopicType("std_srvs/Empty", "d41d8cd98f00b204e9800998ecf8427e") == EMPTY
    assert TopicType("std_srvs/Trigger", "937c9679a518e3a18d831e57125ea522") == TRIGGER
    assert TopicType("std_srvs/SetBool", "09fb03525b03e7ea1fd3992bafd87e16") == SET_BOOL


def test_requests() -> None:
    assert serialise_request(EMPTY, argument=None) == serialise_request(TRIGGER, argument=None) == b""
    assert (serialise_request(SET_BOOL, argument=True), serialise_request(SET_BOOL, argument=False)) == (b"\1", b"\0")
    with pytest.raises(MessageError, match="std_srvs/SetBool needs to be told true or false"):
        serialise_request(SET_BOOL, argument=None)
    for kind in (EMPTY, TRIGGER):
        with pytest.raises(MessageError, match=f"{kind.name} takes no argument"):
            serialise_request(kind, argument=False)


def test_responses() -> None:
    assert deserialise_response(EMPTY, b"") is None
    assert deserialise_response(TRIGGER, b"\1\4\0\0\0done") == Answer(success=True, message="done")
    assert deserialise_response(SET_BOOL, b"\0\0\0\0\0") == Answer(success=False, message="")
    assert deserialise_response(TRIGGER, b"\1\4\0\0\0fr\xfch") == Answer(success=True, message="fr\ufffdh")


@given(st.sampled_from([EMPTY, TRIGGER, SET_BOOL]), st.binary(max_size=12))
def test_other_bytes_are_no_response(kind: TopicType, data: bytes) -> None:
    whole = not data if kind == EMPTY else len(data) >= 5 and int.from_bytes(data[1:5], "little") == len(data) - 5
    if whole:
        deserialise_response(kind, data)
        return
    with pytest.raises(MessageError, match=f"{len(data)} bytes are not a {kind.name}Response"):
        deserialise_response(kind, data)
