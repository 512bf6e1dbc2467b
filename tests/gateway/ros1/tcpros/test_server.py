from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import pytest

from gateway.ros1.tasks import TaskScope
from gateway.ros1.tcpros.publisher import Publication
from gateway.ros1.tcpros.server import TcprosServer
from gateway.ros1.wire.header import decode_header, encode_header
from gateway.ros1.wire.tcpros import Offer, TopicType
from tests.gateway.ros1.golden.messages import IMAGE_MD5, SUBSCRIBER_HEADER, TOPIC
from tests.waiting import until

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

OFFER = Offer(TOPIC, TopicType("sensor_msgs/Image", IMAGE_MD5), "definition")


@pytest.fixture
def publication() -> Publication:
    return Publication(OFFER, queue_size=1)


@pytest.fixture
def timeout_s() -> float:
    return 60.0


@pytest.fixture
async def server(publication: Publication, timeout_s: float) -> AsyncIterator[TcprosServer]:
    async with (
        TaskScope() as scope,
        TcprosServer(
            callerid=lambda: "/ours",
            host="127.0.0.1",
            publications={TOPIC: publication},
            scope=scope,
            timeout=timeout_s,
        ) as running,
    ):
        yield running


@asynccontextmanager
async def connected(server: TcprosServer, data: bytes) -> AsyncIterator[asyncio.StreamReader]:
    reader, writer = await asyncio.open_connection(*server.address)
    writer.write(data)
    try:
        yield reader
    finally:
        writer.transport.abort()


async def read_header(reader: asyncio.StreamReader) -> dict[str, str]:
    size = int.from_bytes(await reader.readexactly(4), "little")
    return decode_header(await reader.readexactly(size))


async def test_rospys_header_is_answered_and_messages_follow(server: TcprosServer, publication: Publication) -> None:
    async with connected(server, SUBSCRIBER_HEADER) as reader:
        assert (await read_header(reader))["callerid"] == "/ours"
        await until(lambda: publication.subscriber_count, "it is counted")
        publication.publish(b"pixels")
        assert await reader.readexactly(10) == b"\x06\x00\x00\x00pixels"


async def test_header_may_come_in_pieces(server: TcprosServer) -> None:
    reader, writer = await asyncio.open_connection(*server.address)
    for start in range(0, len(SUBSCRIBER_HEADER), 500):
        writer.write(SUBSCRIBER_HEADER[start : start + 500])
        await asyncio.sleep(0)
    assert (await read_header(reader))["topic"] == TOPIC
    writer.close()
    await writer.wait_closed()


async def test_subscriber_that_does_not_fit_is_told_why(server: TcprosServer, publication: Publication) -> None:
    wrong = encode_header({"callerid": "/peer", "topic": TOPIC, "md5sum": "0" * 32})
    async with connected(server, wrong) as reader:
        assert "is sensor_msgs/Image" in (await read_header(reader))["error"]
        assert await reader.read() == b""
    assert publication.subscriber_count == 0


@pytest.mark.parametrize("data", [b"GET / HTTP/1.1\r\n\r\n", b"\xff\xff\xff\xff", b"\x04\x00\x00\x00\x09\x00\x00\x00"])
async def test_garbage_is_hung_up_on_and_harms_nobody(server: TcprosServer, data: bytes) -> None:
    async with connected(server, data) as reader:
        with pytest.raises((asyncio.IncompleteReadError, ConnectionError)):
            await reader.readexactly(1)
    async with connected(server, SUBSCRIBER_HEADER) as reader:
        assert (await read_header(reader))["topic"] == TOPIC


@pytest.mark.parametrize("timeout_s", [0.3])
async def test_silent_peer_is_hung_up_on(server: TcprosServer) -> None:
    async with connected(server, b"") as reader:
        assert await reader.read() == b""
