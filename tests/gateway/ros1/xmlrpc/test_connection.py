from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager, suppress
from typing import TYPE_CHECKING, Any

import pytest

from gateway.ros1.wire.xmlrpc import MethodCall, encode
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.ros1.xmlrpc.server import XmlRpcServer
from tests.waiting import until

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

MAX_BODY_BYTES = 10_000
BIG = b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 9999\r\n\r\n<methodCall>" + b" " * 9000


class Echo:
    def call(self, method: str, params: tuple[Any, ...]) -> tuple[str, Any]:  # noqa: ARG002 - as ROS's API has it
        return "", list(params)


@asynccontextmanager
async def connected(server: XmlRpcServer) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    reader, writer = await asyncio.open_connection("127.0.0.1", int(server.uri.rstrip("/").rpartition(":")[2]))
    try:
        yield reader, writer
    finally:
        writer.transport.abort()
        with suppress(ConnectionError):
            await writer.wait_closed()


async def test_requests_under_way_hold_no_more_than_four_bodies(caplog: pytest.LogCaptureFixture) -> None:
    async with XmlRpcServer(Echo(), host="127.0.0.1", timeout=60.0, max_body_bytes=MAX_BODY_BYTES) as server:
        async with connected(server) as a, connected(server) as b, connected(server) as c, connected(server) as d:
            for _, writer in (a, b, c, d):
                writer.write(BIG)
            async with connected(server) as (reader, writer):
                writer.write(BIG[:-4000])
                await until(lambda: "the largest" in caplog.text, "one is cut off")
                assert not reader.at_eof()
                # The others are served as ever.
                async with XmlRpcClient() as client:
                    assert await client.call(server.uri, "echo", "x" * 1000) == ["x" * 1000]
        assert caplog.text.count("is the largest") == 1


async def test_refusal_arrives_while_more_is_on_its_way() -> None:
    async with (
        XmlRpcServer(Echo(), host="127.0.0.1", timeout=60.0, max_body_bytes=MAX_BODY_BYTES) as server,
        connected(server) as (reader, writer),
    ):
        writer.write(b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 4000000\r\n\r\n" + bytes(4_000_000))
        assert (await reader.readline()).split()[1] == b"400"
        await writer.drain()


async def test_half_closed_after_the_call_is_answered() -> None:
    body = encode(MethodCall("echo", ("a",)))
    async with XmlRpcServer(Echo(), host="127.0.0.1", timeout=60.0) as server, connected(server) as (reader, writer):
        writer.write(b"POST / HTTP/1.0\r\nContent-Length: %d\r\n\r\n" % len(body) + body)
        writer.write_eof()
        assert (await reader.read()).startswith(b"HTTP/1.1 200 ")


@pytest.mark.parametrize(("sent", "answer"), [(b"", b""), (b"POST / HT", b"HTTP/1.1 400 ")])
async def test_ended_before_the_call_was(sent: bytes, answer: bytes) -> None:
    async with XmlRpcServer(Echo(), host="127.0.0.1", timeout=60.0) as server, connected(server) as (reader, writer):
        writer.write(sent)
        writer.write_eof()
        assert (await reader.read())[: len(answer) or None] == answer


async def test_leaving_closes_what_is_open() -> None:
    async with XmlRpcServer(Echo(), host="127.0.0.1", timeout=60.0) as server, connected(server) as (reader, writer):
        writer.write(BIG)
        await asyncio.sleep(0)
        await server.__aexit__(None, None, None)
        with suppress(ConnectionError):
            assert await reader.read() == b""
