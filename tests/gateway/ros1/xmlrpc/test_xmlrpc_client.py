from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import pytest

from gateway.ros1.errors import Ros1Error, UnreachableError, XmlRpcError
from gateway.ros1.wire.xmlrpc import MethodResponse, encode
from gateway.ros1.xmlrpc.client import AT_A_HOST, XmlRpcClient

if TYPE_CHECKING:
    from collections.abc import AsyncIterator


@asynccontextmanager
async def peer(answer: bytes) -> AsyncIterator[str]:
    """An HTTP server that sends these bytes and closes; without any, it never answers. Yields its URI."""
    writers: list[asyncio.StreamWriter] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writers.append(writer)
        await reader.readuntil(b"</methodCall>")
        if answer:
            writer.write(answer)
            writer.close()

    listener = await asyncio.start_server(serve, "127.0.0.1", 0)
    yield f"http://127.0.0.1:{listener.sockets[0].getsockname()[1]}/"
    listener.close()
    for writer in writers:
        writer.close()
    await asyncio.gather(*(writer.wait_closed() for writer in writers), return_exceptions=True)


def ok(body: bytes, headers: bytes = b"") -> bytes:
    return b"HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\n" + headers + b"\r\n" + body


GOOD = encode(MethodResponse([1, "", "value"]))


async def test_answer_without_a_length_is_taken() -> None:
    async with peer(ok(GOOD)) as uri, XmlRpcClient() as client:
        assert await client.call(uri, "getUri", "/a") == "value"


@pytest.mark.parametrize(
    ("answer", "error"),
    [
        (ok(GOOD, b"Content-Length: 100000\r\n"), XmlRpcError),
        (ok(b"<methodResponse>" + b" " * 5000), XmlRpcError),
        (ok(b"garbage"), XmlRpcError),
        (ok(b""), XmlRpcError),
        (ok(GOOD, b"Content-Length: 1000\r\n"), UnreachableError),
        (b"HTTP/1.1 500 Oops\r\nContent-Length: 0\r\n\r\n", UnreachableError),
        (b"HTTP/1.1 302 Found\r\nLocation: http://127.0.0.1:9/\r\nContent-Length: 0\r\n\r\n", UnreachableError),
        (b"not HTTP\r\n\r\n", UnreachableError),
    ],
    ids=["announced too long", "too long", "garbage", "empty", "cut off", "status 500", "redirect", "not HTTP"],
)
async def test_bad_answers(answer: bytes, error: type[Ros1Error]) -> None:
    async with peer(answer) as uri, XmlRpcClient(max_body_bytes=4000) as client:
        with pytest.raises(error):
            await client.call(uri, "getUri", "/a")


async def test_no_answer_ends_at_the_deadline() -> None:
    async with peer(b"") as uri, XmlRpcClient(timeout=0.05) as client:
        with pytest.raises(UnreachableError, match="no answer within"):
            await client.call(uri, "getUri", "/a")


async def test_a_machine_that_keeps_silent_keeps_nobody_from_calling_another() -> None:
    async with peer(b"") as silent, peer(ok(GOOD)) as uri, XmlRpcClient(timeout=60) as client:
        unanswered = [
            asyncio.create_task(client.call(silent.replace("127.0.0.1", "localhost"), "getUri", "/a"))
            for _ in range(2 * AT_A_HOST)
        ]
        await asyncio.sleep(0)
        async with asyncio.timeout(30):
            assert await client.call(uri, "getUri", "/a") == "value"
        for call in unanswered:
            call.cancel()
        await asyncio.wait(unanswered)


async def test_client_has_to_be_entered() -> None:
    with pytest.raises(RuntimeError):
        await XmlRpcClient().call("http://127.0.0.1:9/", "getUri", "/a")
