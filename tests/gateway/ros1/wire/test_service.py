from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.ros1.errors import LinkRefusedError, Ros1Error, TcprosError, TypeMismatchError, WireError
from gateway.ros1.tcpros.service_client import SET_BOOL, TRIGGER
from gateway.ros1.wire.header import decode_header, encode_header
from gateway.ros1.wire.service import (
    MAX_REASON_BYTES,
    ServiceAccepted,
    ServiceAnswered,
    ServiceConnection,
    ServiceEvent,
    ServiceFailed,
)
from gateway.ros1.wire.tcpros import TopicType
from tests.gateway.ros1.golden.messages import SERVICE_ANSWER, SERVICE_FAILURE, SERVICE_HEADER, SERVICE_REFUSAL

ANY = TopicType("*", "*")


def caller(expected: TopicType = TRIGGER, max_response_bytes: int = 1000) -> ServiceConnection:
    return ServiceConnection(
        callerid="/ours", service="/good", expected=expected, max_response_bytes=max_response_bytes
    )


def outcome_of(connection: ServiceConnection, *pieces: bytes) -> tuple[list[ServiceEvent], str]:
    """Return the events, and the error after them."""
    events: list[ServiceEvent] = []
    try:
        for piece in pieces:
            connection.receive_data(piece)
            while (event := connection.next_event()) is not None:
                events.append(event)
    except Ros1Error as error:
        return events, repr(error)
    return events, ""


def service_header(**changes: str) -> bytes:
    return encode_header({"callerid": "/peer", "type": TRIGGER.name, "md5sum": TRIGGER.md5sum} | changes)


def answer(data: bytes, *, ok: int = 1) -> bytes:
    return bytes([ok]) + struct.pack("<I", len(data)) + data


def test_opening_says_who_wants_what() -> None:
    assert decode_header(caller().opening[4:]) == {
        "callerid": "/ours",
        "service": "/good",
        "md5sum": TRIGGER.md5sum,
        "type": "std_srvs/Trigger",
        "tcp_nodelay": "1",
    }
    assert "type" not in decode_header(caller(ANY).opening[4:])
    assert decode_header(caller(ANY).opening[4:])["md5sum"] == "*"


def test_a_request_has_its_length_before_it() -> None:
    assert ServiceConnection.request(b"") == b"\0\0\0\0"
    assert ServiceConnection.request(b"abc") == b"\3\0\0\0abc"


ACCEPTED = ServiceAccepted(TRIGGER)


@pytest.mark.parametrize("expected", [TRIGGER, ANY, TopicType("std_srvs/Trigger", "*"), TopicType("*", TRIGGER.md5sum)])
def test_an_answer_of_rospy(expected: TopicType) -> None:
    assert outcome_of(caller(expected), SERVICE_HEADER, SERVICE_ANSWER) == (
        [ACCEPTED, ServiceAnswered(b"\1\4\0\0\0done")],
        "",
    )


def test_a_failure_of_rospy() -> None:
    assert outcome_of(caller(), SERVICE_HEADER, SERVICE_FAILURE) == (
        [ACCEPTED, ServiceFailed("error processing request: on purpose")],
        "",
    )


def test_a_refusal_of_rospy() -> None:
    connection = caller()
    connection.receive_data(SERVICE_REFUSAL)
    with pytest.raises(LinkRefusedError, match="md5sums do not match"):
        connection.next_event()


@pytest.mark.parametrize("end", [SERVICE_ANSWER, SERVICE_FAILURE, answer(b"x" * 1001), answer(b""), b"\7" + bytes(4)])
def test_a_stream_split_anywhere_has_the_same_outcome(end: bytes) -> None:
    stream = SERVICE_HEADER + end + b"more"
    whole = outcome_of(caller(), stream)
    for cut in range(len(stream) + 1):
        assert outcome_of(caller(), stream[:cut], stream[cut:]) == whole


@given(st.lists(st.binary(max_size=30), max_size=20))
def test_garbage_split_anywhere_has_the_same_outcome(pieces: list[bytes]) -> None:
    assert outcome_of(caller(), SERVICE_HEADER, *pieces) == outcome_of(caller(), SERVICE_HEADER, b"".join(pieces))


@pytest.mark.parametrize(
    "found",
    [{"type": SET_BOOL.name}, {"md5sum": "0" * 32}, {"type": "*"}, {"md5sum": "*"}],
)
def test_another_type_is_not_asked(found: dict[str, str]) -> None:
    connection = caller()
    connection.receive_data(service_header(**found))
    with pytest.raises(TypeMismatchError, match="/good is"):
        connection.next_event()


@pytest.mark.parametrize("found", [{"type": "*"}, {"md5sum": "*"}])
def test_a_service_of_any_type_is_of_none(found: dict[str, str]) -> None:
    connection = caller(ANY)
    connection.receive_data(service_header(**found))
    with pytest.raises(TypeMismatchError, match="/good is"):
        connection.next_event()


@pytest.mark.parametrize("field", ["type", "md5sum"])
def test_a_header_that_does_not_say_the_type(field: str) -> None:
    fields = decode_header(service_header()[4:])
    del fields[field]
    connection = caller(ANY)
    connection.receive_data(encode_header(fields))
    with pytest.raises(TcprosError, match=f"lacks {field}"):
        connection.next_event()


def test_limits_are_held_before_the_frame_is_there() -> None:
    events, error = outcome_of(caller(), service_header(), answer(b"x" * 1000))
    assert (events[1:], error) == ([ServiceAnswered(b"x" * 1000)], "")
    for end, limit in (
        (b"\1" + struct.pack("<I", 1001), 1000),
        (b"\0" + struct.pack("<I", MAX_REASON_BYTES + 1), MAX_REASON_BYTES),
    ):
        events, error = outcome_of(caller(), service_header(), end)
        assert len(events) == 1
        assert f"over the limit of {limit}" in error
    with pytest.raises(WireError, match="over the limit"):
        _raise(caller(), b"\xff" * 4)


def _raise(connection: ServiceConnection, data: bytes) -> None:
    connection.receive_data(data)
    connection.next_event()


def test_a_reason_need_not_be_text() -> None:
    events, _ = outcome_of(caller(), service_header(), answer(b"\xff!", ok=0))
    assert events[1:] == [ServiceFailed("\ufffd!")]


def test_nothing_comes_after_the_answer() -> None:
    connection = caller()
    outcome_of(connection, service_header() + answer(b"one") + answer(b"two"))
    connection.receive_data(answer(b"three"))
    assert connection.next_event() is None
