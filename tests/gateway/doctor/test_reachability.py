import asyncio
import errno
import socket
from contextlib import closing, suppress

import pytest

from gateway.doctor.evidence import Failure, HostLook, Router, Trouble
from gateway.doctor.reachability import look_at_host, look_at_router, reach, resolve
from gateway.ros1.listening import is_local
from tests.integration.peers.ros import free_port

PATIENCE_S = 5.0


@pytest.mark.parametrize(
    ("host", "address"), [("127.0.0.1", "127.0.0.1"), ("[::1]", "::1"), ("::1", "::1"), ("localhost", "127.0.0.1")]
)
async def test_names_and_addresses(host: str, address: str) -> None:
    assert address in await resolve(host, PATIENCE_S)


@pytest.mark.parametrize("host", ["no-such-host.invalid", "x" * 300, ".."])
async def test_a_name_that_does_not_resolve(host: str) -> None:
    assert await resolve(host, PATIENCE_S) == []
    assert await reach(host, 1, PATIENCE_S) == Trouble(Failure.UNRESOLVED, host, 1)


async def test_a_name_server_that_keeps_silent_costs_its_deadline_only() -> None:
    assert await resolve("localhost", 0) == []


async def test_a_port_at_which_something_listens() -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        assert await reach("localhost", server.getsockname()[1], PATIENCE_S) == "127.0.0.1"


async def test_a_port_at_which_nothing_listens() -> None:
    port = free_port()
    assert await reach("127.0.0.1", port, PATIENCE_S) == Trouble(Failure.DEAD, "127.0.0.1", port, "connection refused")


async def test_a_machine_that_swallows_what_it_is_sent() -> None:
    """A listener whose queue is full drops further connections, as a firewall does."""
    with closing(socket.create_server(("127.0.0.1", 0), backlog=0)) as server:
        address: tuple[str, int] = server.getsockname()
        fillers = [socket.socket() for _ in range(4)]
        for filler in fillers:
            filler.settimeout(0)
            filler.connect_ex(address)
        found = await reach(*address, 0.1)
        for filler in fillers:
            filler.close()
    assert isinstance(found, Trouble)
    assert found.failure is Failure.SILENT


async def test_an_address_without_a_route() -> None:
    found = await reach("255.255.255.255", 1, PATIENCE_S)
    assert isinstance(found, Trouble)
    assert found.failure is Failure.OFF


@pytest.mark.parametrize(("address", "ours"), [("127.0.0.1", True), ("192.0.2.1", False), ("2001:db8::1", False)])
async def test_whose_address_it_is(address: str, *, ours: bool) -> None:
    assert is_local(address) is ours
    assert await look_at_host(address, PATIENCE_S) == HostLook(address, (address,), ours)


def test_where_there_is_no_ipv6_no_such_address_is_local(monkeypatch: pytest.MonkeyPatch) -> None:
    def without_ipv6(family: socket.AddressFamily, kind: socket.SocketKind) -> socket.socket:
        if family == socket.AF_INET6:
            raise OSError(errno.EAFNOSUPPORT, "Address family not supported by protocol")
        return made(family, kind)

    made = socket.socket
    monkeypatch.setattr(socket, "socket", without_ipv6)
    assert not is_local("::1")
    assert is_local("127.0.0.1")


async def test_a_router() -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}?rel=0#iface=lo"
        assert await look_at_router(endpoint, PATIENCE_S) == Router(endpoint)
    dead = await look_at_router(f"tls/127.0.0.1:{free_port()}", PATIENCE_S)
    assert dead.trouble
    assert dead.trouble.failure is Failure.DEAD


async def test_links_without_a_connection_cannot_be_tried() -> None:
    assert await look_at_router("udp/no-such-host.invalid:1", PATIENCE_S) == Router("udp/no-such-host.invalid:1")


async def test_no_socket_is_left_open() -> None:
    ended = asyncio.Event()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionResetError):
            assert await reader.read() == b""
        ended.set()
        writer.close()

    async with await asyncio.start_server(serve, "127.0.0.1", 0) as server, asyncio.timeout(PATIENCE_S):
        await reach("127.0.0.1", server.sockets[0].getsockname()[1], PATIENCE_S)
        await ended.wait()
