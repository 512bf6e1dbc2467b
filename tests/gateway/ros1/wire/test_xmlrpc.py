from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.ros1.errors import FaultError, StatusError, XmlRpcError
from gateway.ros1.wire.xmlrpc import MAX_DEPTH, Body, Decoder, Fault, MethodCall, MethodResponse, encode, result_of
from tests.gateway.ros1.golden.messages import REGISTER_PUBLISHER, REGISTER_PUBLISHER_RESPONSE, TOPIC
from tests.gateway.ros1.support.feeding import decode

# XML itself turns a carriage return into a newline.
texts = st.text(st.characters(exclude_categories=["Cs", "Cc"], exclude_characters="\ufffe\uffff"), max_size=30)
values = st.recursive(
    st.booleans() | st.integers(-(2**31), 2**31 - 1) | st.floats(allow_nan=False, allow_infinity=False) | texts,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(texts, inner, max_size=4),
    max_leaves=10,
)
bodies: st.SearchStrategy[Body] = st.one_of(
    st.builds(MethodCall, st.from_regex(r"[A-Za-z]\w{0,20}", fullmatch=True), st.lists(values, max_size=4).map(tuple)),
    st.builds(MethodResponse, values),
    st.builds(Fault, st.integers(-(2**31), 2**31 - 1), texts),
)


@given(bodies)
def test_decoded_is_what_was_encoded(body: Body) -> None:
    assert decode(encode(body)) == body


def test_call_of_rospy() -> None:
    call = decode(REGISTER_PUBLISHER)
    assert isinstance(call, MethodCall)
    assert call.method == "registerPublisher"
    assert call.params[:3] == ("/golden_publisher", TOPIC, "sensor_msgs/Image")
    assert encode(call) == REGISTER_PUBLISHER


def test_answer_of_rosmaster() -> None:
    assert result_of(decode(REGISTER_PUBLISHER_RESPONSE)) == []


@pytest.mark.parametrize("stream", [REGISTER_PUBLISHER, REGISTER_PUBLISHER_RESPONSE, encode(Fault(3, "no ä & <b>"))])
def test_body_split_at_every_byte_is_the_same(stream: bytes) -> None:
    whole = decode(stream)
    for cut in range(len(stream) + 1):
        decoder = Decoder()
        decoder.feed(stream[:cut])
        decoder.feed(stream[cut:])
        assert decoder.close() == whole


@pytest.mark.parametrize(
    "stream",
    [
        pytest.param(REGISTER_PUBLISHER + b"<x/>", id="bad tail"),
        pytest.param(REGISTER_PUBLISHER[:-3], id="cut off"),
        pytest.param(b"<methodCall><methodName>x</methodName></params></methodCall>", id="not well-formed"),
        pytest.param(
            b"<methodResponse><params><param><value><int>x</int></value></param></params></methodResponse>", id="int"
        ),
    ],
)
def test_bad_body_is_refused_wherever_it_is_split(stream: bytes) -> None:
    for cut in range(len(stream) + 1):
        decoder = Decoder()
        with pytest.raises(XmlRpcError):  # noqa: PT012 - any piece may be where it shows
            decoder.feed(stream[:cut])
            decoder.feed(stream[cut:])
            decoder.close()


def test_body_of_the_largest_size_and_one_byte_more() -> None:
    size = len(REGISTER_PUBLISHER)
    assert isinstance(decode(REGISTER_PUBLISHER, size), MethodCall)
    with pytest.raises(XmlRpcError, match="over the limit"):
        decode(REGISTER_PUBLISHER, size - 1)


def nested(depth: int) -> bytes:
    inner = "<array><data><value>" * depth + "x" + "</value></data></array>" * depth
    return f"<methodResponse><params><param><value>{inner}</value></param></params></methodResponse>".encode()


def test_deepest_nesting_and_one_level_more() -> None:
    deepest = (MAX_DEPTH - 4) // 3
    decode(nested(deepest))
    with pytest.raises(XmlRpcError, match="deeper"):
        decode(nested(deepest + 1))


BOMB = b"""<?xml version="1.0"?><!DOCTYPE bomb [<!ENTITY a "xxxxxxxxxx"><!ENTITY b "&a;&a;&a;&a;">]>
<methodResponse><params><param><value>&b;</value></param></params></methodResponse>"""
EXTERNAL = b"""<?xml version="1.0"?><!DOCTYPE x [<!ENTITY file SYSTEM "file:///etc/hostname">]>
<methodResponse><params><param><value>&file;</value></param></params></methodResponse>"""


@pytest.mark.parametrize(
    "body",
    [
        pytest.param(BOMB, id="entity bomb"),
        pytest.param(EXTERNAL, id="external entity"),
        pytest.param(b'<!DOCTYPE x SYSTEM "http://127.0.0.1/x.dtd"><methodResponse/>', id="DTD"),
        pytest.param(b"", id="nothing"),
        pytest.param(b"<methodResponse>", id="cut off"),
        pytest.param(b"<methodResponse/>", id="no value"),
        pytest.param(b"<html><body>404</body></html>", id="another document"),
        pytest.param(b"\x00\x01\x02", id="not XML"),
        pytest.param(b"<methodCall><params><param><value><int>x</int></value></param></params></methodCall>", id="int"),
        pytest.param(
            b"<methodResponse><fault><value><struct></struct></value></fault></methodResponse>", id="empty fault"
        ),
        pytest.param(b'<?xml version="1.0" encoding="nonsense"?><methodResponse/>', id="encoding"),
    ],
)
def test_malformed_or_dangerous_body_is_refused(body: bytes) -> None:
    with pytest.raises(XmlRpcError):
        decode(body)


@pytest.mark.parametrize(
    "value", [None, 2**31, pytest.param(object(), id="object"), "\x00", "\ud800", {1: "x"}], ids=repr
)
def test_what_xmlrpc_cannot_carry_is_refused(value: Any) -> None:
    with pytest.raises(XmlRpcError):
        encode(MethodResponse(value))


def test_fault_replaces_what_xml_does_not_have() -> None:
    assert decode(encode(Fault(1, "bad \x00 byte"))) == Fault(1, "bad ? byte")


def test_success() -> None:
    assert result_of(MethodResponse([1, "done", {"x": 1}])) == {"x": 1}


@pytest.mark.parametrize("code", [0, -1])
def test_failure_and_error(code: int) -> None:
    with pytest.raises(StatusError, match="not there") as error:
        result_of(MethodResponse([code, "not there", 0]))
    assert error.value.code == code


def test_fault() -> None:
    with pytest.raises(FaultError, match="no such method") as error:
        result_of(Fault(7, "no such method"))
    assert error.value.code == 7


@pytest.mark.parametrize("value", [1, [], [1, "x"], [1, "x", 2, 3], ["1", "x", 0], [1, 2, 3], {"code": 1}])
def test_answer_that_is_no_triple_is_refused(value: Any) -> None:
    with pytest.raises(XmlRpcError):
        result_of(MethodResponse(value))


def test_call_is_no_answer() -> None:
    with pytest.raises(XmlRpcError):
        result_of(MethodCall("shutdown", ()))
