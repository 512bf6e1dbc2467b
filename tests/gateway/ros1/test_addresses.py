from __future__ import annotations

import pytest

from gateway.ros1.addresses import parse_offer, parse_rosrpc, validate_host, validate_master_uri
from gateway.ros1.errors import InvalidNameError


@pytest.mark.parametrize(
    "text",
    [
        "http://robot:11311",
        "http://10.0.0.1:1",
        "http://[::1]:65535",
        "http://[fe80::1%eth0]:11311",
        "http://[::ffff:10.0.0.1]:1",
        "http://a-b.c_d:80",
    ],
)
def test_master_uris(text: str) -> None:
    assert validate_master_uri(text) == validate_master_uri(text + "/") == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "robot:11311",
        "http://robot",
        "http://robot:0",
        "http://robot:65536",
        "http://:1",
        "http://a b:1",
        "rosrpc://robot:1",
        "http://::1:11311",
        "http://fe80::1:11311",
        "http://[abc:11311",
        "http://abc]:11311",
        "http://[abc]:11311",
        "http://[robot]:11311",
        "http://[10.0.0.1]:11311",
        "http://[::::]:11311",
        "http://[fe80::1%]:11311",
        "http://[fe80::1%a/b]:11311",
    ],
)
def test_what_is_no_master_uri(text: str) -> None:
    with pytest.raises(InvalidNameError, match="use one like http://robot:11311"):
        validate_master_uri(text)


@pytest.mark.parametrize("text", ["robot", "robot.local", "10.0.0.1", "::1", "fe80::1", "fe80::1%eth0"])
def test_hosts(text: str) -> None:
    assert validate_host(text) == text


def test_an_address_in_brackets_as_uris_have_it_is_that_address() -> None:
    assert validate_host("[fe80::1]") == "fe80::1"
    assert validate_host("[fe80::1%eth0]") == "fe80::1%eth0"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "bad host",
        "-a",
        "a/b",
        "http://robot",
        "a" * 254,
        "ab:cd",
        "[fe80",
        "fe80::1]",
        "[]",
        "[robot]",
        "::::",
        "::1%",
    ],
)
def test_what_is_no_host(text: str) -> None:
    with pytest.raises(InvalidNameError, match="neither"):
        validate_host(text)


@pytest.mark.parametrize(
    ("uri", "address"),
    [
        ("rosrpc://127.0.0.1:40001", ("127.0.0.1", 40001)),
        ("rosrpc://robot-7.local:1/", ("robot-7.local", 1)),
        ("rosrpc://[::1]:65535", ("::1", 65535)),
        ("rosrpc://[fe80::1%eth0]:1", ("fe80::1%eth0", 1)),
    ],
)
def test_the_address_of_a_service(uri: str, address: tuple[str, int]) -> None:
    assert parse_rosrpc(uri) == address


@pytest.mark.parametrize(
    "uri",
    [
        "",
        "http://robot:1",
        "rosrpc://robot",
        "rosrpc://robot:0",
        "rosrpc://robot:65536",
        "rosrpc://:1",
        "rosrpc://::1:40001",
        "rosrpc://[::::]:40001",
        "x" * 999,
    ],
)
def test_no_address_of_a_service(uri: str) -> None:
    with pytest.raises(InvalidNameError, match="is not a service's address"):
        parse_rosrpc(uri)


def test_what_a_publisher_offers() -> None:
    assert parse_offer(["TCPROS", "robot", 65535]) == ("robot", 65535)


@pytest.mark.parametrize(
    "answer", [0, [], ["TCPROS"], ["UDPROS", "robot", 1], ["TCPROS", "", 1], ["TCPROS", "robot", 65536]]
)
def test_what_is_no_offer(answer: object) -> None:
    with pytest.raises(InvalidNameError, match="instead of TCPROS"):
        parse_offer(answer)
