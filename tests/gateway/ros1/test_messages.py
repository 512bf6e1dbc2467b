from __future__ import annotations

import pytest

from gateway.ros1.errors import InvalidNameError, MessageError, UnknownTypeError
from gateway.ros1.messages import ANY_TYPE, Time, deserialise, message_type, new_message, serialise, service_type
from gateway.ros1.wire.header import decode_header
from tests.gateway.ros1.golden.messages import IMAGE, PUBLISHER_HEADER


@pytest.mark.parametrize(
    ("name", "md5sum"),
    [
        ("std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1"),
        ("sensor_msgs/Image", "060021388200f6f0f447d0fcd9c64743"),
        ("sensor_msgs/CameraInfo", "c9a58c1b0b154e0e6da7578cb991d214"),
        ("sensor_msgs/PointCloud2", "1158d486dd51d683ce2f1be655c3c181"),
        ("tf2_msgs/TFMessage", "94810edda583a504dfda3829e70d7eec"),
        ("tf/tfMessage", "94810edda583a504dfda3829e70d7eec"),
    ],
)
def test_md5sums_are_those_of_ros(name: str, md5sum: str) -> None:
    assert message_type(name).md5sum == md5sum


def test_definition_is_whole_as_rospys_is() -> None:
    theirs = decode_header(PUBLISHER_HEADER[4:])["message_definition"]
    assert code_of(message_type("sensor_msgs/Image").definition) == code_of(theirs)


def code_of(definition: str) -> list[str]:
    """Return a definition's lines without comments."""
    lines = (line.partition("#")[0].split() for line in definition.splitlines())
    return [" ".join(words) for words in lines if words]


def test_any_type() -> None:
    assert message_type("*") is ANY_TYPE


@pytest.mark.parametrize("name", ["sensor_msgs/Nothing", "Image", "sensor_msgs/msg/Image", ""])
def test_unknown_type(name: str) -> None:
    with pytest.raises(UnknownTypeError):
        message_type(name)
    with pytest.raises(UnknownTypeError):
        deserialise(name, b"")


def test_unknown_type_is_no_name_error_for_the_caller() -> None:
    assert not issubclass(UnknownTypeError, InvalidNameError)


def test_image_of_rospy() -> None:
    image = deserialise("sensor_msgs/Image", IMAGE[4:])
    assert (image.width, image.height, image.encoding) == (4, 3, "rgb8")
    assert serialise("sensor_msgs/Image", image) == IMAGE[4:]


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_text_there_and_back(kind: type[bytes]) -> None:
    data = serialise("std_msgs/String", new_message("std_msgs/String", data="['Kiste', 'Palette ä']"))
    assert deserialise("std_msgs/String", kind(data)).data == "['Kiste', 'Palette ä']"


@pytest.mark.parametrize("data", [b"", b"\x05\x00\x00\x00hi", b"\x01\x00\x00\x00hi", b"\x01\x00\x00"])
def test_what_is_no_text_is_refused(data: bytes) -> None:
    with pytest.raises(MessageError):
        deserialise("std_msgs/String", data)


def test_what_does_not_fit_a_field_is_refused() -> None:
    with pytest.raises(MessageError):
        serialise("std_msgs/String", new_message("std_msgs/String", data=5))
    with pytest.raises(MessageError):
        new_message("std_msgs/String", text="x")


@pytest.mark.parametrize(
    ("name", "md5sum"),
    [
        ("std_srvs/Empty", "d41d8cd98f00b204e9800998ecf8427e"),
        ("std_srvs/Trigger", "937c9679a518e3a18d831e57125ea522"),
        ("std_srvs/SetBool", "09fb03525b03e7ea1fd3992bafd87e16"),
    ],
)
def test_service_types_are_those_of_ros(name: str, md5sum: str) -> None:
    service = service_type(name)
    assert (service.name, service.md5sum) == (name, md5sum)
    assert (service.request, service.response) == (message_type(f"{name}Request"), message_type(f"{name}Response"))


@pytest.mark.parametrize("name", ["std_srvs/Nothing", "std_msgs/String", "std_srvs/SetBoolRequest", "*", ""])
def test_unknown_service(name: str) -> None:
    with pytest.raises(UnknownTypeError):
        service_type(name)


def test_answer_of_a_service_there_and_back() -> None:
    name = service_type("std_srvs/SetBool").response.name
    data = serialise(name, new_message(name, success=True, message="done"))
    assert data == b"\x01\x04\x00\x00\x00done"
    assert deserialise(name, data) == new_message(name, success=True, message="done")


@pytest.mark.parametrize("seconds", [-1, 2**32])
def test_seconds_without_a_place_on_the_wire_are_refused(seconds: int) -> None:
    with pytest.raises(MessageError, match="cannot serialise a rosgraph_msgs/Clock"):
        serialise("rosgraph_msgs/Clock", new_message("rosgraph_msgs/Clock", clock=Time(seconds, 0)))
