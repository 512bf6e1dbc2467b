import socket
import threading

import pytest

from bus.session import links
from bus.session.links import why_unreached
from tests.waiting import PATIENCE_S

PLAIN = "no Zenoh router answers there"
WITH_CERTIFICATES = "nothing answers there, or the certificates do not fit"


@pytest.mark.parametrize(
    ("endpoints", "said"),
    [
        ([], PLAIN),
        (["tcp/127.0.0.1:7447"], PLAIN),
        (["tcp/[::1]:7447"], PLAIN),
        (["tcp/localhost:7447", "udp/127.0.0.1:7447"], PLAIN),
        (["tls/127.0.0.1:7447"], WITH_CERTIFICATES),
        (["tcp/127.0.0.1:7447", "quic/localhost:7447"], WITH_CERTIFICATES),
    ],
)
def test_what_may_be_in_the_way_of_a_link(endpoints: list[str], said: str) -> None:
    assert why_unreached(endpoints) == said


def test_a_name_that_does_not_resolve_is_said_and_nothing_else_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(links, "RESOLVING_S", PATIENCE_S)
    (said,) = why_unreached(["tls/no-such-host.invalid:7447"]).split("; ")
    assert said.startswith("no-such-host.invalid does not resolve: ")
    long = "x" * 300
    unresolved, other = why_unreached([f"tcp/{long}:7447", f"tcp/{long}:7448", "tcp/127.0.0.1:7447"]).split("; ")
    assert unresolved.startswith(f"{long} does not resolve: ")
    assert other == PLAIN


def test_a_name_server_that_keeps_silent_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    answered = threading.Event()
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: answered.wait())
    monkeypatch.setattr(links, "RESOLVING_S", 0.0)
    try:
        assert why_unreached(["tcp/central:7447"]) == "central does not resolve: no name server answered within 0 s"
    finally:
        answered.set()
