from __future__ import annotations

import pytest

from gateway.ros1.addresses import validate_host, validate_master_uri
from gateway.ros1.errors import InvalidNameError


@pytest.mark.parametrize("text", ["http://robot:11311", "http://10.0.0.1:1", "http://[::1]:65535", "http://a-b.c_d:80"])
def test_master_uris(text: str) -> None:
    assert validate_master_uri(text) == validate_master_uri(text + "/") == text


@pytest.mark.parametrize(
    "text", ["", "robot:11311", "http://robot", "http://robot:0", "http://robot:65536", "http://:1", "http://a b:1"]
)
def test_what_is_no_master_uri(text: str) -> None:
    with pytest.raises(InvalidNameError, match="looks like http://robot:11311"):
        validate_master_uri(text)


@pytest.mark.parametrize("text", ["robot", "robot.local", "10.0.0.1", "::1", "fe80::1"])
def test_hosts(text: str) -> None:
    assert validate_host(text) == text


@pytest.mark.parametrize("text", ["", "bad host", "-a", "a/b", "http://robot", "a" * 254])
def test_what_is_no_host(text: str) -> None:
    with pytest.raises(InvalidNameError, match="neither"):
        validate_host(text)
