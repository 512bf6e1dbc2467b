"""Whatever comes in, only the documented errors come out."""

from __future__ import annotations

from contextlib import suppress

from hypothesis import example, given, settings
from hypothesis import strategies as st

from gateway.ros1.addresses import parse_rosrpc
from gateway.ros1.errors import (
    HeaderError,
    InvalidNameError,
    LinkRefusedError,
    MessageError,
    TypeMismatchError,
    WireError,
    XmlRpcError,
)
from gateway.ros1.image import decode_image
from gateway.ros1.messages import deserialise
from gateway.ros1.tcpros.service_client import TRIGGER, deserialise_response
from gateway.ros1.wire.header import decode_header
from gateway.ros1.wire.service import ServiceAnswered, ServiceConnection
from gateway.ros1.wire.tcpros import Offer, PublisherConnection, SubscriberConnection, TopicType
from tests.gateway.ros1.golden.messages import (
    IMAGE,
    IMAGE_MD5,
    PUBLISHER_HEADER,
    REGISTER_PUBLISHER,
    REGISTER_PUBLISHER_RESPONSE,
    SERVICE_ANSWER,
    SERVICE_FAILURE,
    SERVICE_HEADER,
    SUBSCRIBER_HEADER,
    TOPIC,
)
from tests.gateway.ros1.support.feeding import decode, events_of

IMAGE_TYPE = TopicType("sensor_msgs/Image", IMAGE_MD5)
TYPES = (
    "sensor_msgs/Image",
    "sensor_msgs/CameraInfo",
    "sensor_msgs/PointCloud2",
    "std_msgs/String",
    "tf2_msgs/TFMessage",
)
many = settings(max_examples=300, deadline=None)


@st.composite
def spoilt(draw: st.DrawFn, good: bytes) -> bytes:
    """Bytes that were good before some of them were overwritten, cut out or put in."""
    data = bytearray(good)
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        data[start : start + draw(st.integers(0, 8))] = draw(st.binary(max_size=8))
    return bytes(data)


@many
@given(st.binary(max_size=300) | spoilt(PUBLISHER_HEADER[4:]))
def test_header(body: bytes) -> None:
    with suppress(HeaderError):
        decode_header(body)


@many
@given(st.binary(max_size=300) | spoilt(PUBLISHER_HEADER + IMAGE))
def test_subscriber_side(stream: bytes) -> None:
    connection = SubscriberConnection(callerid="/ours", topic=TOPIC, expected=IMAGE_TYPE, max_message_bytes=1 << 16)
    with suppress(WireError, LinkRefusedError, TypeMismatchError):
        events_of(connection, stream)


@many
@given(st.binary(max_size=300) | spoilt(SUBSCRIBER_HEADER))
def test_publisher_side(stream: bytes) -> None:
    connection = PublisherConnection(callerid="/ours", offers={TOPIC: Offer(TOPIC, IMAGE_TYPE, "")})
    with suppress(WireError):
        connection.receive_data(stream)


@many
@given(
    st.binary(max_size=300) | spoilt(SERVICE_HEADER + SERVICE_ANSWER) | spoilt(SERVICE_HEADER + SERVICE_FAILURE),
    st.sampled_from([TopicType("*", "*"), TRIGGER]),
)
def test_service(stream: bytes, expected: TopicType) -> None:
    connection = ServiceConnection(callerid="/ours", service="/good", expected=expected, max_response_bytes=1 << 16)
    with suppress(WireError, LinkRefusedError, TypeMismatchError):
        connection.receive_data(stream)
        while (event := connection.next_event()) is not None:
            if isinstance(event, ServiceAnswered):
                with suppress(MessageError):
                    deserialise_response(TRIGGER, event.data)


@many
@given(st.text(max_size=60) | st.builds("rosrpc://{}:{}".format, st.text(max_size=20), st.integers(-1, 70000)))
def test_service_address(uri: str) -> None:
    with suppress(InvalidNameError):
        parse_rosrpc(uri)


@many
@given(st.binary(max_size=300) | spoilt(REGISTER_PUBLISHER) | spoilt(REGISTER_PUBLISHER_RESPONSE))
@example(b"<methodResponse><params><param><value><array></array></value></param></params></methodResponse>")
@example(b"<methodCall><methodName>x</methodName><value><struct><member/></struct></value></methodCall>")
@example(b"<params><value><dateTime.iso8601>x</dateTime.iso8601></value></params>")
@example(b"<params><value><base64>\xc3\xa4</base64></value></params>")
@example(b"<params><value><bigdecimal>x</bigdecimal></value></params>")
def test_xmlrpc(body: bytes) -> None:
    with suppress(XmlRpcError):
        decode(body)


@many
@given(st.binary(max_size=300) | spoilt(IMAGE[4:]))
def test_image(message: bytes) -> None:
    with suppress(MessageError):
        decode_image(message)


@many
@given(st.sampled_from(TYPES), st.binary(max_size=300) | spoilt(IMAGE[4:]))
def test_messages(name: str, message: bytes) -> None:
    with suppress(MessageError):
        deserialise(name, message)
