from __future__ import annotations

import pytest

from gateway.ros1.listening import listen_address, uri_host


@pytest.mark.parametrize(
    ("host", "address"),
    [
        ("127.0.0.1", "127.0.0.1"),
        ("127.0.0.5", "127.0.0.5"),
        ("::1", "::1"),
        ("localhost", "127.0.0.1"),
        ("robot", "0.0.0.0"),  # noqa: S104
        ("10.0.0.7", "0.0.0.0"),  # noqa: S104
        ("fd00::7", "::"),
    ],
)
def test_listens_on_the_loopback_only_for_a_loopback_host(host: str, address: str) -> None:
    assert listen_address(host) == address


def test_host_within_a_uri() -> None:
    assert [uri_host(host) for host in ("robot", "127.0.0.1", "::1")] == ["robot", "127.0.0.1", "[::1]"]
