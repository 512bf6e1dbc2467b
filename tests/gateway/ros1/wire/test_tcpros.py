from __future__ import annotations

import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.ros1.errors import HeaderError, LinkRefusedError, TcprosError, TypeMismatchError, WireError
from gateway.ros1.wire.header import decode_header, encode_header
from gateway.ros1.wire.tcpros import (
    MessageReceived,
    Offer,
    PublisherAccepted,
    PublisherConnection,
    SubscriberAccepted,
    SubscriberConnection,
    SubscriberRefused,
    TopicType,
    message_prefix,
)
from tests.gateway.ros1.golden.messages import (
    IMAGE,
    IMAGE_MD5,
    PUBLISHER_HEADER,
    PUBLISHER_REFUSAL,
    SUBSCRIBER_HEADER,
    TOPIC,
)
from tests.gateway.ros1.support.feeding import events_of, outcome_of

IMAGE_TYPE = TopicType("sensor_msgs/Image", IMAGE_MD5)
STRING_TYPE = TopicType("std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1")
ANY = TopicType("*", "*")
OFFER = Offer(TOPIC, IMAGE_TYPE, "Header header\n", latching=True)


def subscriber(expected: TopicType = IMAGE_TYPE, max_message_bytes: int = 1000) -> SubscriberConnection:
    return SubscriberConnection(callerid="/ours", topic=TOPIC, expected=expected, max_message_bytes=max_message_bytes)


def publisher(*offers: Offer) -> PublisherConnection:
    return PublisherConnection(callerid="/ours", offers={offer.topic: offer for offer in offers or (OFFER,)})


def publisher_header(**changes: str) -> bytes:
    return encode_header({"type": IMAGE_TYPE.name, "md5sum": IMAGE_MD5, "callerid": "/peer"} | changes)


def test_opening_says_who_wants_what() -> None:
    assert decode_header(subscriber().opening[4:]) == {
        "callerid": "/ours",
        "topic": TOPIC,
        "md5sum": IMAGE_MD5,
        "type": "sensor_msgs/Image",
        "tcp_nodelay": "1",
    }


def test_stream_of_rospy() -> None:
    events = events_of(subscriber(), PUBLISHER_HEADER + IMAGE + IMAGE)
    accepted, *messages = events
    assert isinstance(accepted, PublisherAccepted)
    assert (accepted.callerid, accepted.type, accepted.latching) == ("/golden_publisher", IMAGE_TYPE, True)
    assert messages == [MessageReceived(memoryview(IMAGE[4:]))] * 2


def test_stream_split_at_every_byte_gives_the_same_events() -> None:
    stream = PUBLISHER_HEADER + IMAGE + message_prefix(0) + IMAGE
    whole = events_of(subscriber(), stream)
    assert len(whole) == 4
    for cut in range(len(stream) + 1):
        assert events_of(subscriber(), stream[:cut], stream[cut:]) == whole


GOOD = PUBLISHER_HEADER + IMAGE + IMAGE


@pytest.mark.parametrize(
    ("stream", "count", "error"),
    [
        pytest.param(GOOD + message_prefix(1001), 3, "TooLargeError", id="length after messages"),
        pytest.param(GOOD + message_prefix(1001) + IMAGE, 3, "TooLargeError", id="length before a message"),
        pytest.param(PUBLISHER_HEADER + b"\xff" * 9, 1, "TooLargeError", id="length after the header"),
        pytest.param(b"\xff" * 9 + GOOD, 0, "TcprosError", id="length of the header"),
        pytest.param(message_prefix(5) + b"\1\0\0\0x" + IMAGE, 0, "HeaderError", id="header"),
        pytest.param(PUBLISHER_REFUSAL + IMAGE, 0, "LinkRefusedError", id="refusal"),
    ],
)
def test_stream_that_goes_bad_gives_what_was_good_first_wherever_it_is_split(
    stream: bytes, count: int, error: str
) -> None:
    whole = events, reason = outcome_of(subscriber(), stream)
    assert len(events) == count
    assert reason.startswith(error)
    assert outcome_of(subscriber(), *(stream[i : i + 1] for i in range(len(stream)))) == whole
    for cut in range(len(stream) + 1):
        assert outcome_of(subscriber(), stream[:cut], stream[cut:]) == whole


@given(
    st.lists(st.binary(max_size=300), max_size=6),
    st.lists(st.integers(0, 2000), max_size=8),
)
def test_stream_cut_anywhere_gives_the_same_events(bodies: list[bytes], cuts: list[int]) -> None:
    stream = publisher_header() + b"".join(message_prefix(len(body)) + body for body in bodies)
    edges = [0, *sorted(cut for cut in cuts if cut < len(stream)), len(stream)]
    events = events_of(subscriber(), *(stream[start:end] for start, end in pairwise(edges)))
    assert events[1:] == [MessageReceived(memoryview(body)) for body in bodies]


def test_empty_message_is_a_message() -> None:
    assert events_of(subscriber(), publisher_header() + message_prefix(0))[1:] == [MessageReceived(memoryview(b""))]


def test_message_of_the_largest_size_and_one_byte_more() -> None:
    body = bytes(1000)
    assert len(events_of(subscriber(), publisher_header() + message_prefix(1000) + body)) == 2
    with pytest.raises(TcprosError):
        events_of(subscriber(), publisher_header() + message_prefix(1001))


def test_small_messages_do_not_limit_the_header() -> None:
    assert len(events_of(subscriber(max_message_bytes=1), PUBLISHER_HEADER)) == 1


def test_refusal_is_surfaced_before_anything_else_in_the_header() -> None:
    with pytest.raises(LinkRefusedError, match="Client"):
        events_of(subscriber(), PUBLISHER_REFUSAL)
    with pytest.raises(LinkRefusedError, match="no a=b"):
        events_of(subscriber(), encode_header({"type": "x", "error": "no a=b"}))


@pytest.mark.parametrize("fields", [{"error": "x\n" * 100_000}, {"type": "x\n" * 100_000, "md5sum": "0" * 100_000}])
def test_refusal_is_one_line_however_long_the_text(fields: dict[str, str]) -> None:
    with pytest.raises((LinkRefusedError, TypeMismatchError)) as error:
        events_of(subscriber(), encode_header(fields))
    assert len(str(error.value)) < 2000
    assert "\n" not in str(error.value)


def test_names_that_peers_give_themselves_are_short_lines() -> None:
    header = encode_header({"callerid": "/a\x00" * 100_000, "topic": TOPIC, "md5sum": "*"})
    accepted = PublisherConnection(callerid="/ours", offers={TOPIC: Offer(TOPIC, IMAGE_TYPE, "")}).receive_data(header)
    assert isinstance(accepted, SubscriberAccepted)
    assert accepted.callerid.startswith("/a?/a?")
    assert len(accepted.callerid) < 1000


@pytest.mark.parametrize("found", [STRING_TYPE, TopicType(IMAGE_TYPE.name, "0" * 32), TopicType("a/Image", IMAGE_MD5)])
def test_publisher_of_another_type_is_refused(found: TopicType) -> None:
    with pytest.raises(TypeMismatchError):
        events_of(subscriber(), publisher_header(type=found.name, md5sum=found.md5sum))


@pytest.mark.parametrize("changes", [{"type": "*"}, {"md5sum": "*"}])
@pytest.mark.parametrize("expected", [IMAGE_TYPE, ANY])
def test_publisher_of_any_type_is_refused(changes: dict[str, str], expected: TopicType) -> None:
    with pytest.raises(TypeMismatchError):
        events_of(subscriber(expected), publisher_header(**changes))


def test_any_type_takes_the_publishers() -> None:
    (event,) = events_of(subscriber(ANY), publisher_header())
    assert isinstance(event, PublisherAccepted)
    assert event.type == IMAGE_TYPE


@pytest.mark.parametrize("key", ["type", "md5sum"])
def test_publisher_that_does_not_say_its_type_is_refused(key: str) -> None:
    fields = {"type": IMAGE_TYPE.name, "md5sum": IMAGE_MD5}
    del fields[key]
    with pytest.raises(TcprosError, match=key):
        events_of(subscriber(), encode_header(fields))


def test_header_over_the_limit_is_refused_before_it_comes() -> None:
    with pytest.raises(TcprosError):
        events_of(subscriber(), struct.pack("<I", (1 << 20) + 1))
    with pytest.raises(TcprosError):
        publisher().receive_data(struct.pack("<I", (1 << 20) + 1))


def test_rospy_subscriber_is_accepted_however_its_header_is_cut() -> None:
    for cut in range(len(SUBSCRIBER_HEADER)):
        connection = publisher()
        assert connection.receive_data(SUBSCRIBER_HEADER[:cut]) is None
        event = connection.receive_data(SUBSCRIBER_HEADER[cut:])
        assert isinstance(event, SubscriberAccepted)
        assert (event.callerid, event.topic, event.tcp_nodelay) == ("/golden_subscriber", TOPIC, True)


def test_reply_says_all_that_recorders_need() -> None:
    event = publisher().receive_data(SUBSCRIBER_HEADER)
    assert event is not None
    assert decode_header(event.reply[4:]) == {
        "callerid": "/ours",
        "topic": TOPIC,
        "type": "sensor_msgs/Image",
        "md5sum": IMAGE_MD5,
        "message_definition": "Header header\n",
        "latching": "1",
    }


def test_bytes_after_the_header_are_ignored_however_they_are_cut() -> None:
    stream = SUBSCRIBER_HEADER + b"\xff" * 100
    for cut in range(len(stream) + 1):
        connection = publisher()
        first, second = connection.receive_data(stream[:cut]), connection.receive_data(stream[cut:])
        assert isinstance(first or second, SubscriberAccepted)
        assert None in (first, second)
        assert connection.receive_data(b"\xff" * 100_000) is None


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"topic": "/other"}, "/ours does not publish /other"),
        ({"md5sum": "0" * 32}, "is sensor_msgs/Image"),
        ({"type": "std_msgs/String"}, "is sensor_msgs/Image"),
        ({"service": "/add"}, "/ours offers no services"),
    ],
)
def test_subscriber_that_does_not_fit_is_answered_with_an_error(changes: dict[str, str], reason: str) -> None:
    fields = {"callerid": "/peer", "topic": TOPIC, "md5sum": IMAGE_MD5, "type": IMAGE_TYPE.name} | changes
    event = publisher().receive_data(encode_header(fields))
    assert isinstance(event, SubscriberRefused)
    assert reason in event.reason
    assert decode_header(event.reply[4:]) == {"error": event.reason}


@pytest.mark.parametrize("key", ["callerid", "topic", "md5sum"])
def test_subscriber_that_does_not_say_enough_is_answered_with_an_error(key: str) -> None:
    fields = {"callerid": "/peer", "topic": TOPIC, "md5sum": IMAGE_MD5}
    del fields[key]
    event = publisher().receive_data(encode_header(fields))
    assert isinstance(event, SubscriberRefused)
    assert key in event.reason


@pytest.mark.parametrize("fields", [{"md5sum": "*"}, {"md5sum": "*", "type": "*"}, {"md5sum": IMAGE_MD5}])
def test_subscriber_to_any_type_is_accepted(fields: dict[str, str]) -> None:
    event = publisher().receive_data(encode_header({"callerid": "/peer", "topic": TOPIC} | fields))
    assert isinstance(event, SubscriberAccepted)


@pytest.mark.parametrize(
    ("stream", "error"),
    [(b"GET / HTTP/1.1\r\n\r\n", TcprosError), (b"\x04\x00\x00\x00\xff\xff\xff\xff" + SUBSCRIBER_HEADER, HeaderError)],
    ids=["length", "header"],
)
def test_garbage_instead_of_a_header_however_it_is_cut(stream: bytes, error: type[WireError]) -> None:
    for cut in range(len(stream) + 1):
        connection = publisher()
        with pytest.raises(error):  # noqa: PT012 - either piece may be where it shows
            connection.receive_data(stream[:cut])
            connection.receive_data(stream[cut:])


@given(st.lists(st.binary(max_size=50), max_size=5), st.integers(1, 40))
def test_both_sides_pumped_against_each_other(bodies: list[bytes], piece: int) -> None:
    ours, theirs = subscriber(), publisher()
    event = None
    for start in range(0, len(ours.opening), piece):
        event = theirs.receive_data(ours.opening[start : start + piece]) or event
    assert isinstance(event, SubscriberAccepted)
    stream = event.reply + b"".join(message_prefix(len(body)) + body for body in bodies)
    assert events_of(ours, *(stream[start : start + piece] for start in range(0, len(stream), piece))) == [
        PublisherAccepted("/ours", OFFER.type, OFFER.definition, OFFER.latching),
        *(MessageReceived(memoryview(body)) for body in bodies),
    ]


def test_both_sides_disagree() -> None:
    event = publisher().receive_data(subscriber(STRING_TYPE).opening)
    assert isinstance(event, SubscriberRefused)
    with pytest.raises(LinkRefusedError, match="is sensor_msgs/Image"):
        events_of(subscriber(STRING_TYPE), event.reply)


def test_prefix_of_the_largest_message_and_one_byte_more() -> None:
    assert message_prefix(0xFFFFFFFF) == b"\xff\xff\xff\xff"
    with pytest.raises(TcprosError):
        message_prefix(1 << 32)
