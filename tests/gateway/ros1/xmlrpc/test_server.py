from __future__ import annotations

import asyncio
import gc
import socket
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager, suppress
from typing import TYPE_CHECKING, Any

import pytest

from gateway.ros1.errors import FaultError, StatusError, UnknownMethodError, UnreachableError, XmlRpcError
from gateway.ros1.wire.xmlrpc import MethodCall, encode
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.ros1.xmlrpc.server import MAX_CONNECTIONS, XmlRpcServer

if TYPE_CHECKING:
    from collections.abc import AsyncIterator


class Api:
    def call(self, method: str, params: tuple[Any, ...]) -> tuple[str, Any]:
        match method:
            case "echo":
                return "echoed", list(params)
            case "fail":
                raise StatusError(0, "not today", [])
            case "big":
                return "", 2**40
            case "mistaken":
                raise (KeyError if params == ("lookup",) else TypeError)("what its author did not think of")
            case _:
                raise UnknownMethodError(f"no method {method!r}")


@pytest.fixture
def timeout_s() -> float:
    return 60.0


@pytest.fixture
async def server(timeout_s: float) -> AsyncIterator[XmlRpcServer]:
    async with XmlRpcServer(Api(), host="127.0.0.1", timeout=timeout_s, max_body_bytes=10_000) as running:
        yield running


@pytest.fixture
async def client() -> AsyncIterator[XmlRpcClient]:
    async with XmlRpcClient(timeout=60.0) as running:
        yield running


@asynccontextmanager
async def connected(server: XmlRpcServer, request: bytes) -> AsyncIterator[asyncio.StreamReader]:
    """Connect and send raw bytes."""
    port = int(server.uri.rstrip("/").rpartition(":")[2])
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(request)
    try:
        yield reader
    finally:
        writer.transport.abort()


async def raw(server: XmlRpcServer, request: bytes) -> bytes:
    """Return the first line of the answer to raw bytes."""
    async with connected(server, request) as reader:
        return await reader.readline()


async def test_call_and_answer(server: XmlRpcServer, client: XmlRpcClient) -> None:
    assert await client.call(server.uri, "echo", "a", 1, [True, {"x": 0.5}]) == ["a", 1, [True, {"x": 0.5}]]


async def test_many_calls_at_once(server: XmlRpcServer, client: XmlRpcClient) -> None:
    answers = await asyncio.gather(*(client.call(server.uri, "echo", i) for i in range(100)))
    assert answers == [[i] for i in range(100)]


async def test_failure_keeps_its_code_and_text(server: XmlRpcServer, client: XmlRpcClient) -> None:
    with pytest.raises(StatusError, match="not today") as error:
        await client.call(server.uri, "fail")
    assert error.value.code == 0


async def test_unknown_method_is_a_fault(server: XmlRpcServer, client: XmlRpcClient) -> None:
    with pytest.raises(FaultError, match="no method 'nothing'"):
        await client.call(server.uri, "nothing")


@pytest.mark.parametrize("mistake", ["lookup", "type"])
async def test_mistake_in_a_method_is_a_failure_and_in_the_log(
    server: XmlRpcServer, client: XmlRpcClient, mistake: str, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(StatusError, match="internal failure") as error:
        await client.call(server.uri, "mistaken", mistake)
    assert error.value.code == 0
    assert "mistaken failed" in caplog.text
    assert "what its author did not think of" in caplog.text
    assert await client.call(server.uri, "echo", 1) == [1]


async def test_answer_that_xmlrpc_cannot_carry_is_a_fault(server: XmlRpcServer, client: XmlRpcClient) -> None:
    with pytest.raises(FaultError, match="cannot be XML-RPC"):
        await client.call(server.uri, "big")


async def test_request_over_the_limit_is_refused(server: XmlRpcServer, client: XmlRpcClient) -> None:
    with pytest.raises(UnreachableError, match="400"):
        await client.call(server.uri, "echo", "x" * 10_000)


@pytest.mark.parametrize(
    ("request_bytes", "status"),
    [
        (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"405"),
        (b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 3\r\n\r\nabc", b"400"),
        (b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 17\r\n\r\n<methodResponse/>", b"400"),
    ],
    ids=["GET", "not XML", "no call"],
)
async def test_what_is_no_call(server: XmlRpcServer, request_bytes: bytes, status: bytes) -> None:
    assert (await raw(server, request_bytes)).split()[1] == status


CALL = encode(MethodCall("echo", ("a",)))
HEAD = f"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: {len(CALL)}\r\n\r\n".encode()


async def rest_of(reader: asyncio.StreamReader) -> bytes:
    """Return what comes until the connection ends, in whichever way."""
    with suppress(ConnectionError):
        return await reader.read()
    return b""


@pytest.mark.parametrize(
    "sent",
    [b"", b"POST / HT", HEAD[:-2], HEAD, HEAD + CALL[:-1]],
    ids=["nothing", "half a line", "half a head", "head", "half a body"],
)
@pytest.mark.parametrize("timeout_s", [0.3])
async def test_connection_without_a_whole_request_in_time_is_closed(
    server: XmlRpcServer, client: XmlRpcClient, sent: bytes
) -> None:
    async with connected(server, sent) as reader:
        assert await rest_of(reader) == b""
    assert await echo_when_served(server, client) == [1]


async def test_one_request_a_connection(server: XmlRpcServer) -> None:
    async with connected(server, 2 * (HEAD + CALL)) as reader:
        assert (await rest_of(reader)).count(b"HTTP/1.1 200") == 1


async def test_connections_over_the_limit_are_closed_at_once_and_later_ones_are_served(
    client: XmlRpcClient, caplog: pytest.LogCaptureFixture
) -> None:
    async with XmlRpcServer(Api(), host="127.0.0.1", timeout=60.0) as server:
        async with AsyncExitStack() as stack:
            silent = [await stack.enter_async_context(connected(server, b"")) for _ in range(MAX_CONNECTIONS)]
            async with connected(server, HEAD + CALL) as reader:
                assert await rest_of(reader) == b""
            assert not any(reader.at_eof() for reader in silent)
            assert caplog.messages.count(f"127.0.0.1 is turned away: {MAX_CONNECTIONS} connections already") == 1
        assert await echo_when_served(server, client) == [1]


async def echo_when_served(server: XmlRpcServer, client: XmlRpcClient) -> Any:
    """Return the answer of the first call that is not turned away."""
    async with asyncio.timeout(60):
        while True:
            with suppress(UnreachableError):
                return await client.call(server.uri, "echo", 1)
            await asyncio.sleep(0.01)


async def test_server_goes_on_after_garbage(server: XmlRpcServer, client: XmlRpcClient) -> None:
    await raw(server, b"\x00\x01\x02 garbage\r\n\r\n")
    assert await client.call(server.uri, "echo", 1) == [1]


async def test_port_that_is_taken_is_an_error_and_leaves_nothing(server: XmlRpcServer) -> None:
    port = int(server.uri.rstrip("/").rpartition(":")[2])
    with pytest.raises(OSError, match="Address already in use"):
        async with XmlRpcServer(Api(), host="127.0.0.1", port=port):
            pass


@pytest.mark.parametrize("turns", range(6))
async def test_connection_that_is_being_made_when_the_server_leaves_is_closed(turns: int) -> None:
    with socket.socket() as connection:
        connection.settimeout(0)
        async with XmlRpcServer(Api(), host="127.0.0.1", timeout=60.0) as server:
            with suppress(BlockingIOError):
                connection.connect(("127.0.0.1", int(server.uri.rstrip("/").rpartition(":")[2])))
            for _ in range(turns):
                await asyncio.sleep(0)
        async with asyncio.timeout(60):
            with suppress(ConnectionError):
                assert await asyncio.get_running_loop().sock_recv(connection, 1) == b""


async def test_nobody_is_there(client: XmlRpcClient) -> None:
    with pytest.raises(UnreachableError):
        await client.call("http://127.0.0.1:9/", "echo")


@pytest.mark.parametrize("uri", ["", "nonsense", "http://", "ftp://127.0.0.1/", "http://127.0.0.1:99999/"])
async def test_uri_that_is_none(client: XmlRpcClient, uri: str) -> None:
    with pytest.raises(UnreachableError):
        await client.call(uri, "echo")


async def test_parameter_that_xmlrpc_cannot_carry(server: XmlRpcServer, client: XmlRpcClient) -> None:
    with pytest.raises(XmlRpcError):
        await client.call(server.uri, "echo", None)


def test_request_body_is_what_rospy_would_send() -> None:
    assert encode(MethodCall("echo", ("a",))).startswith(b"<?xml version='1.0'?>\n<methodCall>\n<methodName>echo<")


@pytest.mark.parametrize("steps", range(5))
async def test_connections_that_come_when_it_ends_are_closed(steps: int, caplog: pytest.LogCaptureFixture) -> None:
    with ExitStack() as stack:
        async with XmlRpcServer(Api(), host="127.0.0.1") as server:
            address = ("127.0.0.1", int(server.uri.rstrip("/").rpartition(":")[2]))
            late = [stack.enter_context(socket.create_connection(address)) for _ in range(5)]
            for _ in range(steps):
                await asyncio.sleep(0)
        for connection in late:
            connection.setblocking(False)  # noqa: FBT003 - socket's own signature
            with suppress(ConnectionResetError):
                async with asyncio.timeout(60):
                    assert await asyncio.get_running_loop().sock_recv(connection, 1) == b""
    gc.collect()
    assert caplog.text == ""
