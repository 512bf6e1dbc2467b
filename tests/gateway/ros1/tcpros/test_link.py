from __future__ import annotations

import asyncio
import socket
import struct
from contextlib import ExitStack, asynccontextmanager
from typing import TYPE_CHECKING

import pytest

from gateway.ros1.errors import HeaderError, Ros1Error, TcprosError, UnreachableError
from gateway.ros1.resolver import Resolver
from gateway.ros1.tcpros.link import run_link
from gateway.ros1.wire.framing import FrameBudget
from gateway.ros1.wire.tcpros import MessageReceived, SubscriberConnection, SubscriberEvent, TopicType
from tests.gateway.ros1.golden.messages import IMAGE, IMAGE_MD5, PUBLISHER_HEADER, TOPIC

if TYPE_CHECKING:
    from collections.abc import AsyncIterator


@asynccontextmanager
async def publisher(data: bytes, *, hang: bool = False) -> AsyncIterator[tuple[str, int]]:
    """Send these bytes to whoever connects; yields the address."""
    done = asyncio.Event()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(4096)
        writer.write(data)
        if hang:
            await done.wait()
        writer.close()

    async with await asyncio.start_server(serve, "127.0.0.1", 0) as server:
        yield server.sockets[0].getsockname()
        done.set()


async def receive(
    address: tuple[str, int],
    timeout_s: float = 5.0,
    *,
    message_timeout: float = 30.0,
    budget: FrameBudget | None = None,
) -> list[SubscriberEvent]:
    events: list[SubscriberEvent] = []
    expected = TopicType("sensor_msgs/Image", IMAGE_MD5)
    connection = SubscriberConnection(callerid="/ours", topic=TOPIC, expected=expected, budget=budget)
    await run_link(
        address,
        connection,
        events.append,
        resolver=Resolver(),
        handshake_timeout=timeout_s,
        message_timeout=message_timeout,
    )
    return events


@pytest.mark.parametrize("host", ["no-such-host.invalid", "robot..lan", "x" * 64, "\u00e9" * 64])
async def test_a_host_that_is_none_is_unreachable(host: str) -> None:
    with pytest.raises(UnreachableError, match="no TCPROS connection"):
        await receive((host, 1))


async def test_events_come_until_the_stream_ends() -> None:
    async with publisher(PUBLISHER_HEADER + IMAGE * 3) as address:
        assert len(await receive(address)) == 4


@pytest.mark.parametrize("size", [0, 1, 100_000, 9 << 20])
async def test_message_of_any_size_comes_while_the_stream_stays_open(size: int) -> None:
    messages: list[memoryview] = []
    came = asyncio.Event()

    def on_event(event: SubscriberEvent) -> None:
        if isinstance(event, MessageReceived):
            messages.append(event.data)
        if len(messages) == 3:
            came.set()

    body = bytes(range(256)) * (size // 256) + bytes(size % 256)
    message = struct.pack("<I", size) + body
    connection = SubscriberConnection(callerid="/ours", topic=TOPIC, expected=TopicType("*", "*"))
    async with publisher(PUBLISHER_HEADER + message * 3, hang=True) as address:
        link = asyncio.create_task(run_link(address, connection, on_event, resolver=Resolver(), handshake_timeout=5.0))
        await came.wait()
        link.cancel()
    assert messages == [body] * 3


async def test_message_that_is_cut_off_is_none() -> None:
    async with publisher(PUBLISHER_HEADER + IMAGE[:-1]) as address:
        assert len(await receive(address)) == 1


@pytest.mark.parametrize("data", [b"", PUBLISHER_HEADER[:-1]])
async def test_stream_that_ends_before_the_header_does(data: bytes) -> None:
    async with publisher(data) as address:
        with pytest.raises(UnreachableError, match="before the header"):
            await receive(address)


async def test_header_that_does_not_come_in_time() -> None:
    async with publisher(PUBLISHER_HEADER[:-1], hang=True) as address:
        with pytest.raises(UnreachableError, match=r"no TCPROS connection to 127.0.0.1:\d+: no header within 1 s"):
            await receive(address, 1.0)


async def test_a_machine_that_does_not_answer() -> None:
    with socket.create_server(("127.0.0.1", 0), backlog=0) as full, ExitStack() as stack:
        for _ in range(2):  # which is one more than are taken in while nobody accepts: the system drops what comes then
            filling = stack.enter_context(socket.socket())
            filling.settimeout(0)
            filling.connect_ex(full.getsockname())
        with pytest.raises(UnreachableError, match=r"no TCPROS connection to 127.0.0.1:\d+: no answer within 0.2 s"):
            await receive(full.getsockname(), 0.2)


async def test_nobody_listens() -> None:
    with pytest.raises(UnreachableError):
        await receive(("127.0.0.1", 9))


async def test_error_of_the_parser_ends_the_link() -> None:
    async with publisher(b"\x01\x00\x00\x00x", hang=True) as address:
        with pytest.raises(HeaderError):
            await receive(address)


async def test_messages_before_a_bad_one_are_handed_over() -> None:
    events: list[SubscriberEvent] = []
    connection = SubscriberConnection(callerid="/ours", topic=TOPIC, expected=TopicType("*", "*"))
    async with publisher(PUBLISHER_HEADER + IMAGE + IMAGE + b"\xff\xff\xff\xff", hang=True) as address:
        with pytest.raises(TcprosError, match="over the limit"):
            await run_link(address, connection, events.append, resolver=Resolver(), handshake_timeout=5.0)
    assert len(events) == 3


async def test_error_of_the_receiver_ends_the_link() -> None:
    def refuse(_event: SubscriberEvent) -> None:
        raise Ros1Error("not mine")

    connection = SubscriberConnection(callerid="/ours", topic=TOPIC, expected=TopicType("*", "*"))
    async with publisher(PUBLISHER_HEADER + IMAGE, hang=True) as address:
        with pytest.raises(Ros1Error, match="not mine"):
            await run_link(address, connection, refuse, resolver=Resolver(), handshake_timeout=5.0)


@pytest.mark.parametrize("held", [4, 5, len(IMAGE) - 1])
async def test_message_that_never_ends_is_given_up(held: int) -> None:
    async with publisher(PUBLISHER_HEADER + IMAGE + IMAGE[:held], hang=True) as address:
        with pytest.raises(TcprosError, match="not whole after"):
            await receive(address, message_timeout=0.05)


async def test_publisher_that_says_nothing_for_long_is_kept() -> None:
    async with publisher(PUBLISHER_HEADER + IMAGE, hang=True) as address:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.3):
                await receive(address, message_timeout=0.02)


async def test_what_a_message_held_is_given_back_when_the_link_ends() -> None:
    budget = FrameBudget(10 << 20)
    announced = (1 << 20).to_bytes(4, "little")
    async with publisher(PUBLISHER_HEADER + announced + bytes(1 << 19)) as address:
        await receive(address, budget=budget)
    assert budget.held_bytes == 0
