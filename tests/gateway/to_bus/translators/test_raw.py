import pytest

from gateway.ros1.messages import message_type
from gateway.ros1.tcpros.subscriber import Message
from gateway.ros1.wire.tcpros import PublisherAccepted, TopicType
from gateway.to_bus.stream import MALFORMED
from schemas.header import MAX_LABEL
from schemas.ros import MAX_DEFINITION, MAX_MD5, MAX_TEXT, RawMessage, Text
from tests.gateway.sensing import camera_info, received, text
from tests.gateway.to_bus.translators.translating import dropped, forward, translated


@pytest.mark.parametrize("sent", ["", "ready", "['Kiste', 'Palette ä']", "x" * MAX_TEXT])
def test_a_text_arrives_as_it_is(sent: str) -> None:
    made = translated(Text, "text/mode", text(sent))
    assert made.text == sent
    assert (made.header.robot, made.header.camera, made.header.stamp_ns) == ("r1", "", 0)


def test_a_text_in_another_encoding_arrives_as_ros_tools_show_it() -> None:
    latin = received("std_msgs/String", b"\x05\x00\x00\x00Gr\xfc\xdfe")
    assert translated(Text, "text/mode", latin).text == "Gr\ufffd\ufffde"


def test_what_is_no_text_or_too_long_is_malformed() -> None:
    assert dropped("text/mode", received("std_msgs/String", b"\x05\x00\x00\x00hi")) == {MALFORMED: 1}
    assert dropped("text/mode", received("std_msgs/String", b"\x01\x00\x00\x00hi")) == {MALFORMED: 1}
    assert dropped("text/mode", received("std_msgs/String", b"\x00\x00")) == {MALFORMED: 1}
    assert dropped("text/mode", text("x" * (MAX_TEXT + 1))) == {MALFORMED: 1}


@pytest.mark.parametrize("latching", [False, True])
def test_a_message_of_any_type_arrives_with_its_type(*, latching: bool) -> None:
    sent, kind = camera_info(), message_type("sensor_msgs/CameraInfo")
    message = received(kind.name, bytes(sent.data), latching=latching)
    made = translated(RawMessage, "ros/info", message)
    assert (made.type, made.md5, made.definition) == (kind.name, kind.md5sum, kind.definition)
    assert made.latched == latching
    assert bytes(made.data) == sent.data
    assert (made.header.camera, made.header.stamp_ns) == ("", 0)


def of_type(name: str, md5sum: str, definition: str) -> Message:
    return Message(b"", "", PublisherAccepted("/own", TopicType(name, md5sum), definition, latching=False))


def test_a_type_that_nobody_else_knows_and_a_message_without_fields() -> None:
    made = translated(RawMessage, "ros/own", of_type("own_msgs/Own", "0" * 32, ""))
    assert (made.type, bytes(made.data)) == ("own_msgs/Own", b"")


def test_a_definition_that_its_publisher_does_not_send_is_the_known_one_of_the_same_type() -> None:
    known = message_type("sensor_msgs/CameraInfo")
    for md5sum, definition in ((known.md5sum, known.definition), ("0" * 32, "")):
        made = translated(RawMessage, "ros/info", of_type(known.name, md5sum, ""))
        assert (made.type, made.md5, made.definition) == (known.name, md5sum, definition)
    sent = translated(RawMessage, "ros/info", of_type(known.name, known.md5sum, "uint32 own"))
    assert sent.definition == "uint32 own"


@pytest.mark.parametrize(
    ("name", "md5sum", "definition", "fits"),
    [
        ("x" * MAX_LABEL, "0" * MAX_MD5, "d" * MAX_DEFINITION, True),
        ("x" * (MAX_LABEL + 1), "", "", False),
        ("x", "0" * (MAX_MD5 + 1), "", False),
        ("x", "", "d" * (MAX_DEFINITION + 1), False),
    ],
    ids=["longest", "type", "md5sum", "definition"],
)
def test_what_a_publisher_says_of_itself_is_bounded(name: str, md5sum: str, definition: str, *, fits: bool) -> None:
    assert (forward("ros/own").take(of_type(name, md5sum, definition), 0) is not None) == fits
