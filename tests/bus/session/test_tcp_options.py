import socket
import struct
from pathlib import Path

import pytest

from bus import open_bus
from bus.session import tcp_options
from bus.session.tcp_options import LINGER_S, UNSENT_BYTES, tune
from tests.bus.sessions import client, router
from tests.contract.conftest import free_endpoint
from tests.waiting import until


def linger(connection: socket.socket) -> tuple[int, int]:
    on, seconds = struct.unpack("ii", connection.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))
    return on, seconds


def unsent(connection: socket.socket) -> int:
    return connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT)


@pytest.mark.parametrize(
    ("family", "host", "locator"),
    [
        (socket.AF_INET, "127.0.0.1", "tcp/127.0.0.1:{}"),
        (socket.AF_INET, "127.0.0.1", "tls/127.0.0.1:{}?rel=0#iface=lo"),
        (socket.AF_INET6, "::1", "tcp/[::1]:{}"),
    ],
)
def test_only_connections_of_that_address_are_tuned(family: socket.AddressFamily, host: str, locator: str) -> None:
    with socket.socket(family) as server, socket.socket(family) as client, socket.socket(family) as other:
        server.bind((host, 0))
        server.listen()
        client.connect(server.getsockname())
        other.connect(server.getsockname())
        tune([locator.format(client.getsockname()[1])])
        assert linger(client) == (1, LINGER_S)
        assert unsent(client) == UNSENT_BYTES
        assert linger(other) == (0, 0)
        assert unsent(other) != UNSENT_BYTES
        client.sendall(b"still open")


@pytest.mark.parametrize("locator", ["tcp/127.0.0.1:1", "nonsense"])
def test_an_address_of_nobody_finds_nothing(locator: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as client:
        tune([locator])
        assert linger(client) == (0, 0)


def test_no_file_is_left_open() -> None:
    def open_files() -> int:
        return len(list(Path("/proc/self/fd").iterdir()))

    with socket.socket() as unconnected, Path(__file__).open() as file:
        before = open_files()
        tune(["tcp/127.0.0.1:1"])
        assert open_files() == before
        assert file.readable()
        assert linger(unconnected) == (0, 0)


async def test_a_link_counts_where_the_system_does_not_tell_what_is_connected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tcp_options, "_FILES", Path("/proc/self/no such folder"))
    endpoint = free_endpoint()
    async with (
        open_bus(router(endpoint)),
        open_bus(client(endpoint)) as robot,
    ):
        await until(lambda: robot.link_problem == "")
