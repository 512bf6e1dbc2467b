from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.ros1.errors import HeaderError
from gateway.ros1.wire.header import MAX_FIELDS, MAX_HEADER_BYTES, decode_header, encode_header
from tests.gateway.ros1.golden.messages import IMAGE_MD5, PUBLISHER_HEADER, PUBLISHER_REFUSAL, SUBSCRIBER_HEADER, TOPIC

keys = st.text(st.characters(exclude_characters="=", exclude_categories=["Cs"]), min_size=1, max_size=20)
values = st.text(st.characters(exclude_categories=["Cs"]), max_size=200)


def field(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


@given(st.dictionaries(keys, values, max_size=MAX_FIELDS))
def test_decoded_is_what_was_encoded(fields: dict[str, str]) -> None:
    encoded = encode_header(fields)
    assert struct.unpack_from("<I", encoded) == (len(encoded) - 4,)
    assert decode_header(encoded[4:]) == fields


def test_publisher_header_of_rospy() -> None:
    fields = decode_header(PUBLISHER_HEADER[4:])
    definition = fields.pop("message_definition")
    assert definition.count("=" * 80) == 1
    assert fields == {
        "callerid": "/golden_publisher",
        "latching": "1",
        "md5sum": IMAGE_MD5,
        "topic": TOPIC,
        "type": "sensor_msgs/Image",
    }


def test_subscriber_header_of_rospy() -> None:
    fields = decode_header(SUBSCRIBER_HEADER[4:])
    assert fields["callerid"] == "/golden_subscriber"
    assert (fields["md5sum"], fields["tcp_nodelay"], fields["topic"]) == (IMAGE_MD5, "1", TOPIC)


def test_refusal_of_rospy() -> None:
    assert list(decode_header(PUBLISHER_REFUSAL[4:])) == ["error"]


def test_value_may_hold_an_equals_sign() -> None:
    assert decode_header(field(b"error=a=b")) == {"error": "a=b"}


def test_last_of_equal_keys_counts() -> None:
    assert decode_header(field(b"a=1") + field(b"a=2")) == {"a": "2"}


def test_empty_header_has_no_fields() -> None:
    assert decode_header(b"") == {}


@pytest.mark.parametrize(
    "body",
    [
        pytest.param(b"\x01\x00\x00", id="cut off in a length"),
        pytest.param(b"\x04\x00\x00\x00a=1", id="one byte too short"),
        pytest.param(b"\xff\xff\xff\xffa=1", id="4 GB field"),
        pytest.param(field(b"novalue"), id="no equals sign"),
        pytest.param(field(b"=value"), id="no key"),
        pytest.param(field(b""), id="empty field"),
        pytest.param(field(b"\xff=a"), id="key is not UTF-8"),
        pytest.param(field(b"a=1") * (MAX_FIELDS + 1), id="a field too many"),
        pytest.param(bytes(MAX_HEADER_BYTES + 1), id="a byte too many"),
    ],
)
def test_malformed_header_is_refused(body: bytes) -> None:
    with pytest.raises(HeaderError):
        decode_header(body)


def test_as_many_fields_as_allowed() -> None:
    assert decode_header(field(b"a=1") * MAX_FIELDS) == {"a": "1"}


@pytest.mark.parametrize(
    "fields",
    [
        {"": "value"},
        {"a=b": "value"},
        {"a": "\ud800"},
        {"a": "x" * MAX_HEADER_BYTES},
        {str(i): "" for i in range(MAX_FIELDS + 1)},
    ],
    ids=["no key", "equals sign in key", "surrogate", "too long", "too many"],
)
def test_what_cannot_be_a_header_is_refused(fields: dict[str, str]) -> None:
    with pytest.raises(HeaderError):
        encode_header(fields)


def test_a_definition_whose_comments_are_not_utf8_is_read() -> None:
    body = field(b"type=acme/Pose") + field("message_definition=float32 yaw # in \u00b0\n".encode("latin-1"))
    assert decode_header(body) == {"type": "acme/Pose", "message_definition": "float32 yaw # in \ufffd\n"}
