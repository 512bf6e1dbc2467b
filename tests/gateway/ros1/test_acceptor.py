from __future__ import annotations

import resource
import socket
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

from gateway.ros1.listening import Acceptor, listen
from tests.waiting import until

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as entered:
        yield entered


async def test_each_connection_is_handed_over_until_closed(stack: ExitStack) -> None:
    got: list[socket.socket] = []
    peers: list[str] = []

    def on_connection(connection: socket.socket, peer: str) -> None:
        got.append(stack.enter_context(connection))
        peers.append(peer)

    listener = listen("127.0.0.1")
    address = listener.getsockname()
    acceptor = Acceptor(listener, on_connection)
    for _ in range(3):
        stack.enter_context(socket.create_connection(address))
    await until(lambda: len(got) == 3, "all are accepted")
    assert peers == ["127.0.0.1"] * 3
    assert [connection.gettimeout() for connection in got] == [0.0] * 3
    acceptor.close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(address)


async def test_without_descriptors_it_waits_for_one(stack: ExitStack, caplog: pytest.LogCaptureFixture) -> None:
    got: list[socket.socket] = []
    listener = listen("127.0.0.1")
    acceptor = Acceptor(listener, lambda connection, _: got.append(stack.enter_context(connection)))
    stack.callback(acceptor.close)
    stack.enter_context(socket.create_connection(listener.getsockname()))
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (3, hard))
        await until(lambda: "can be accepted" in caplog.text, "it is said")
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    await until(lambda: got, "it is accepted")
    assert caplog.text.count("can be accepted") == 1
