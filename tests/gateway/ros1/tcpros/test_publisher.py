from __future__ import annotations

import asyncio
import socket
import threading
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from gateway.ros1.tcpros.publisher import Publication
from gateway.ros1.wire.tcpros import Offer, SubscriberAccepted, TopicType, message_prefix
from tests.waiting import until

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

HUGE = bytes(20 << 20)  # more than the kernel buffers for one connection
ACCEPTED = SubscriberAccepted("/peer", "/chat", tcp_nodelay=True, reply=b"reply")


def publication(
    *,
    latching: bool = False,
    queue_size: int = 1,
    on_demand: Callable[[bool], None] | None = None,
    passive: Callable[[str], bool] | None = None,
) -> Publication:
    offer = Offer("/chat", TopicType("a/A", "0"), "", latching)
    return Publication(offer, queue_size=queue_size, on_demand=on_demand, passive=passive)


@asynccontextmanager
async def subscriber(to: Publication, accepted: SubscriberAccepted = ACCEPTED) -> AsyncIterator[asyncio.StreamReader]:
    """Connect to a publication as its server would; yields what the subscriber reads, past the reply."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        reader, writer = await asyncio.open_connection(*listener.getsockname())
        ours, _ = listener.accept()
    ours.setblocking(False)  # noqa: FBT003 - socket's own signature
    with ours:
        serving = asyncio.ensure_future(to.serve(ours, accepted))
        assert await reader.readexactly(5) == b"reply"
        try:
            yield reader
        finally:
            writer.transport.abort()
            await serving


@asynccontextmanager
async def talkative(to: Publication, enough: threading.Event) -> AsyncIterator[None]:
    """Send to a publication what no subscriber sends, faster than it is read, for at most 3 seconds: then `enough`."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        peer = socket.create_connection(listener.getsockname())
        ours, _ = listener.accept()
    ours.setblocking(False)  # noqa: FBT003 - socket's own signature

    def give_up() -> None:
        enough.set()
        peer.shutdown(socket.SHUT_RDWR)

    giving_up = threading.Timer(3, give_up)
    with ours, peer:
        serving = asyncio.ensure_future(to.serve(ours, ACCEPTED))
        talking = threading.Thread(target=talk, args=(peer,))
        giving_up.start()
        talking.start()
        await asyncio.sleep(0.1)
        try:
            yield
        finally:
            giving_up.cancel()
            peer.shutdown(socket.SHUT_RDWR)
            await serving
            talking.join()


def talk(peer: socket.socket) -> None:
    with suppress(OSError):
        while True:
            peer.sendall(bytes(1 << 20))


async def read_message(reader: asyncio.StreamReader) -> bytes:
    return await reader.readexactly(int.from_bytes(await reader.readexactly(4), "little"))


@pytest.mark.parametrize("size", [0, 1, (64 << 10) - 1, 64 << 10, 1 << 20])
async def test_messages_of_all_sizes_are_framed(size: int) -> None:
    topic = publication()
    async with subscriber(topic) as reader:
        topic.publish(b"x" * size)
        assert await reader.readexactly(4) == message_prefix(size)
        assert await reader.readexactly(size) == b"x" * size
    assert (topic.counters.sent, topic.counters.bytes) == (1, size)


async def test_slow_subscriber_gets_the_newest_and_delays_nobody() -> None:
    topic = publication()
    async with subscriber(topic) as slow, subscriber(topic) as fast:
        topic.publish(HUGE)
        assert await read_message(fast) == HUGE
        for i in range(100):
            topic.publish(b"%d" % i)
            assert await read_message(fast) == b"%d" % i
        assert topic.counters.replaced == 99
        assert await read_message(slow) == HUGE
        assert await read_message(slow) == b"99"


async def test_queue_keeps_as_many_as_it_is_told() -> None:
    topic = publication(queue_size=3)
    async with subscriber(topic) as reader:
        for i in range(5):
            topic.publish(b"%d" % i)
        assert [await read_message(reader) for _ in range(3)] == [b"2", b"3", b"4"]
    assert topic.counters.replaced == 2


async def test_latched_message_goes_to_newcomers() -> None:
    topic = publication(latching=True)
    topic.publish(b"old")
    topic.publish(b"new")
    async with subscriber(topic) as first, subscriber(topic) as second:
        assert [await read_message(reader) for reader in (first, second)] == [b"new", b"new"]


async def test_message_without_subscribers_is_gone() -> None:
    topic = publication()
    topic.publish(b"unheard")
    async with subscriber(topic) as reader:
        topic.publish(b"heard")
        assert await read_message(reader) == b"heard"


async def test_subscriber_that_leaves_is_forgotten() -> None:
    topic = publication()
    async with subscriber(topic):
        assert topic.subscriber_count == 1
    assert topic.subscriber_count == 0
    topic.publish(b"to nobody")


async def test_subscriber_that_leaves_in_the_middle_of_a_message() -> None:
    topic = publication()
    async with subscriber(topic) as reader:
        topic.publish(HUGE)
        await reader.readexactly(1000)
    assert topic.subscriber_count == 0
    assert topic.counters.sent == 0


async def test_subscriber_that_talks_without_end_keeps_nobody_from_being_served() -> None:
    topic, enough = publication(), threading.Event()
    async with subscriber(topic) as quiet, talkative(topic, enough):
        topic.publish(b"news")
        assert await read_message(quiet) == b"news"
        assert not enough.is_set()


async def test_closing_ends_the_connections() -> None:
    topic = publication()
    async with subscriber(topic) as reader:
        topic.close()
        assert await reader.read() == b""
        await until(lambda: topic.subscriber_count == 0, "the subscriber is forgotten")


async def test_demand_is_told_when_the_first_subscriber_comes_and_when_the_last_one_goes() -> None:
    told: list[bool] = []
    topic = publication(on_demand=told.append)
    assert told == []
    async with subscriber(topic):
        assert told == [True]
        async with subscriber(topic):
            pass
        assert told == [True]
    assert told == [True, False]
    async with subscriber(topic):
        assert told == [True, False, True]


async def test_demand_is_not_told_after_closing() -> None:
    told: list[bool] = []
    topic = publication(on_demand=told.append)
    async with subscriber(topic):
        topic.close()
        await until(lambda: topic.subscriber_count == 0, "the subscriber is forgotten")
    assert told == [True]


def test_queue_has_to_hold_something() -> None:
    with pytest.raises(ValueError, match="queue_size"):
        publication(queue_size=0)


async def test_passive_subscribers_are_no_demand_and_get_what_others_get() -> None:
    said: list[bool] = []
    to = publication(on_demand=said.append, passive=lambda node: node == "/record")
    async with subscriber(to, replace(ACCEPTED, callerid="/record")) as recording:
        assert (said, to.wanted, to.subscriber_count) == ([], False, 1)
        async with subscriber(to):
            assert (said, to.wanted, to.subscriber_count) == ([True], True, 2)
            to.publish(b"seen")
            assert await recording.readexactly(8) == message_prefix(4) + b"seen"
        assert (said, to.wanted, to.subscriber_count) == ([True, False], False, 1)
