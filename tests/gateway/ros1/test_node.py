from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack, asynccontextmanager
from typing import TYPE_CHECKING

import pytest

from gateway.ros1.errors import InvalidNameError, Ros1Error, StatusError, UnknownTypeError
from gateway.ros1.node import Node
from gateway.ros1.xmlrpc.client import XmlRpcClient
from services.simulator.ros_master.master import RosMaster
from tests.gateway.ros1.support.nodes import node
from tests.waiting import until

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from gateway.ros1.tcpros.subscriber import Message

STRING = "std_msgs/String"
NOBODY = "http://127.0.0.1:9/"


async def test_message_goes_from_node_to_node(master: RosMaster) -> None:
    got: list[Message] = []
    async with (
        node("/a", master) as a,
        node("/b", master) as b,
        a.advertise("/chat", STRING) as publication,
        b.subscribe("/chat", STRING, got.append) as subscription,
    ):
        await until(lambda: publication.subscriber_count == 1, "they are connected")
        publication.publish(b"one")
        await until(lambda: got, "the message has come")
        assert publication.counters.sent == 1
        link = subscription.counters.links[a.uri]
        assert (link.messages, link.bytes, link.connected) == (1, 3, True)
    assert (bytes(got[0].data), got[0].callerid, got[0].uri) == (b"one", "/a", a.uri)


async def test_publication_tells_whether_it_is_wanted(master: RosMaster) -> None:
    told: list[bool] = []
    async with (
        node("/a", master) as a,
        node("/b", master) as b,
        a.advertise("/chat", STRING, on_demand=told.append),
    ):
        await until(lambda: a.registered, "it is registered")
        assert told == []
        async with b.subscribe("/chat", STRING, print):
            await until(lambda: told == [True], "the demand is told")
        await until(lambda: told == [True, False], "its end is told")


async def test_node_hears_itself(master: RosMaster) -> None:
    got: list[Message] = []
    async with (
        node("/a", master) as a,
        a.advertise("/chat", STRING, latch=True) as publication,
        a.subscribe("/chat", STRING, got.append),
    ):
        publication.publish(b"me")
        await until(lambda: got, "the message has come")


async def test_relative_and_private_topics(master: RosMaster) -> None:
    async with (
        node("/ns/a", master) as a,
        a.advertise("chat", STRING) as public,
        a.advertise("~chat", STRING) as private,
    ):
        assert (public.topic, private.topic) == ("/ns/chat", "/ns/a/chat")
        assert a.publications() == {"/ns/chat": STRING, "/ns/a/chat": STRING}


async def test_leaving_unregisters(master: RosMaster) -> None:
    async with node("/watch", master) as watch:
        async with (
            node("/a", master) as a,
            a.advertise("/chat", STRING),
            a.subscribe("/color", "sensor_msgs/Image", print),
        ):
            await until(lambda: a.registered, "it is registered")
            state = await watch.master.get_system_state()
            assert (state.publishers, state.subscribers) == ({"/chat": ("/a",)}, {"/color": ("/a",)})
        state = await watch.master.get_system_state()
        assert (state.publishers, state.subscribers) == ({}, {})
        with pytest.raises(StatusError):
            await watch.master.lookup_node("/a")


async def test_error_of_the_body_stays_as_it_is_and_leaves_nothing(master: RosMaster) -> None:
    with pytest.raises(ValueError, match="mine"):  # noqa: PT012 - the block is what is tested
        async with node("/a", master) as a, a.advertise("/chat", STRING):
            await until(lambda: a.registered, "it is registered")
            raise ValueError("mine")
    async with node("/watch", master) as watch:
        assert (await watch.master.get_system_state()).publishers == {}


async def test_leaving_does_not_wait_for_an_absent_master() -> None:
    async with asyncio.timeout(10), Node("/a", master_uri=NOBODY, poll_interval=100) as a, a.advertise("/chat", STRING):
        pass


async def test_leaving_a_master_that_hangs_takes_one_deadline_however_much_there_is_to_unregister() -> None:
    async with AsyncExitStack() as silence, AsyncExitStack() as stack:
        async with RosMaster() as master:
            port = int(master.uri.rstrip("/").rpartition(":")[2])
            a = await stack.enter_async_context(Node("/a", master_uri=master.uri, poll_interval=100, timeout=100))
            for i in range(10):
                await stack.enter_async_context(a.advertise(f"/out{i}", STRING))
                await stack.enter_async_context(a.subscribe(f"/in{i}", STRING, print))
            await until(lambda: a.registered, "it is registered")
        asked = await silence.enter_async_context(silent_listener(port))
        async with asyncio.timeout(10):  # 21 deadlines would take longer
            await stack.aclose()
        assert asked.is_set()


@asynccontextmanager
async def silent_listener(port: int) -> AsyncIterator[asyncio.Event]:
    """Accept connections and never answer; yields what is set once somebody has connected."""
    connected, ended = asyncio.Event(), asyncio.Event()

    async def serve(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connected.set()
        await ended.wait()
        writer.close()

    async with await asyncio.start_server(serve, "127.0.0.1", port):
        yield connected
        ended.set()


async def test_subscribing_again_at_once_finds_who_is_there(master: RosMaster) -> None:
    async with (
        node("/b", master) as b,
        b.advertise("/chat", STRING, latch=True) as publication,
        Node("/a", master_uri=master.uri, poll_interval=100) as a,
    ):
        publication.publish(b"kept")
        for _ in range(3):
            got: list[Message] = []
            async with a.subscribe("/chat", STRING, got.append):
                pass
            async with a.subscribe("/chat", STRING, got.append):
                await until(lambda: got, "the message has come")  # noqa: B023 - awaited within the loop


async def test_subscribing_again_after_leaving(master: RosMaster) -> None:
    async with (
        node("/a", master) as a,
        node("/b", master) as b,
        b.advertise("/chat", STRING, latch=True) as publication,
    ):
        publication.publish(b"kept")
        for _ in range(3):
            got: list[Message] = []
            async with a.subscribe("/chat", STRING, got.append):
                await until(lambda: got, "the message has come")  # noqa: B023 - awaited within the loop


async def test_publisher_that_leaves_is_dropped_and_one_that_comes_is_heard(master: RosMaster) -> None:
    got: list[Message] = []
    async with node("/b", master) as b, b.subscribe("/chat", STRING, got.append) as subscription:
        for name in ("/first", "/second"):
            async with node(name, master) as a, a.advertise("/chat", STRING, latch=True) as publication:
                publication.publish(name.encode())
                await until(lambda: got and got[-1].callerid == name, "it is heard")  # noqa: B023
            await until(lambda: not subscription.counters.links, "it is dropped")
        assert subscription.counters.links == {}
    assert [bytes(message.data) for message in got] == [b"/first", b"/second"]


async def test_one_topic_is_subscribed_and_advertised_once(master: RosMaster) -> None:
    async with node("/a", master) as a, a.advertise("/chat", STRING), a.subscribe("/chat", STRING, print):
        with pytest.raises(Ros1Error, match="publishes /chat already"):
            async with a.advertise("chat", STRING):
                pass
        with pytest.raises(Ros1Error, match="subscribes to /chat already"):
            async with a.subscribe("chat", STRING, print):
                pass


async def test_bad_names_and_types(master: RosMaster) -> None:
    with pytest.raises(InvalidNameError):
        node("relative", master)
    async with node("/a", master) as a:
        with pytest.raises(InvalidNameError):
            async with a.subscribe("no spaces", STRING, print):
                pass
        with pytest.raises(UnknownTypeError):
            async with a.subscribe("/chat", "std_msgs/Nothing", print):
                pass
        with pytest.raises(InvalidNameError):
            async with a.advertise("/chat", "*"):
                pass
        assert a.subscriptions() == a.publications() == {}


async def test_callback_that_fails_is_counted_logged_and_harms_nothing(
    master: RosMaster, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(message: Message) -> None:
        raise ValueError(f"cannot take {bytes(message.data).decode()}")

    async with (
        node("/a", master) as a,
        a.advertise("/chat", STRING, queue_size=10) as publication,
        a.subscribe("/chat", STRING, fail) as subscription,
    ):
        await until(lambda: publication.subscriber_count, "they are connected")
        for data in (b"one", b"two"):
            publication.publish(data)
        await until(lambda: subscription.counters.callback_errors == 2, "both have failed")
        assert subscription.counters.failures.total() == 0
    assert "cannot take one" in caplog.text
    assert a.uri in caplog.text


async def test_name_that_is_taken_is_left_to_the_other_and_costs_no_registration(master: RosMaster) -> None:
    async with node("/a", master) as first, first.advertise("/chat", STRING):
        await until(lambda: first.registered, "the first is registered")
        async with node("/a", master) as second, second.advertise("/other", STRING):
            await until(lambda: first.name == "/a_2" and first.registered, "the first has another name")
            await until(lambda: second.registered, "the second is registered")
            assert (second.name, first.shutdown_requested.is_set()) == ("/a", False)
            state = await second.master.get_system_state()
            assert state.publishers == {"/chat": ("/a_2",), "/other": ("/a",)}
            async with first.advertise("/later", STRING):
                await until(lambda: first.registered, "it registers more")
                assert (await second.master.get_system_state()).publishers["/later"] == ("/a_2",)


async def test_name_that_is_taken_while_the_master_is_away_waits_for_it() -> None:
    async with AsyncExitStack() as stack:
        async with RosMaster() as master:
            port = int(master.uri.rstrip("/").rpartition(":")[2])
            a = await stack.enter_async_context(Node("/a", master_uri=master.uri, poll_interval=0.05))
            await stack.enter_async_context(a.advertise("/chat", STRING))
            await until(lambda: a.registered, "it is registered")
        async with XmlRpcClient() as client:
            await client.call(a.uri, "shutdown", "/master", "[/a] Reason: new node registered with same name")
        await until(lambda: a.master_answers is False, "the master is missed")
        await stack.enter_async_context(RosMaster(port=port))
        await until(lambda: a.name == "/a_2" and a.registered, "it has another name")


async def test_node_that_is_asked_to_end_is_told_to_its_owner(master: RosMaster) -> None:
    async with node("/a", master) as a, a.advertise("/chat", STRING), XmlRpcClient() as client:
        await until(lambda: a.registered, "it is registered")
        await client.call(a.uri, "shutdown", "/rosnode", "user request")
        assert a.shutdown_requested.is_set()
        async with node("/watch", master) as watch, asyncio.timeout(10):
            while (await watch.master.get_system_state()).publishers:  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.02)


async def test_master_that_restarts_is_told_again() -> None:
    got: list[Message] = []
    async with AsyncExitStack() as stack:
        async with RosMaster() as first:
            uri, port = first.uri, int(first.uri.rstrip("/").rpartition(":")[2])
            a = await stack.enter_async_context(Node("/a", master_uri=uri, poll_interval=0.05))
            await stack.enter_async_context(a.subscribe("/chat", STRING, got.append))
            await until(lambda: a.registered, "it is registered")
        second = await stack.enter_async_context(RosMaster(port=port))
        b = await stack.enter_async_context(node("/b", second))
        publication = await stack.enter_async_context(b.advertise("/chat", STRING, latch=True))
        publication.publish(b"again")
        await until(lambda: got, "the message has come")


async def test_slave_api_of_a_running_node(master: RosMaster) -> None:
    async with (
        node("/a", master) as a,
        a.advertise("/chat", STRING, latch=True) as publication,
        a.subscribe("/chat", STRING, lambda _: None) as subscription,
        XmlRpcClient() as client,
    ):
        publication.publish(b"12345")
        await until(lambda: any(link.messages for link in subscription.counters.links.values()), "the message has come")
        assert await client.call(a.uri, "getMasterUri", "/test") == master.uri
        assert await client.call(a.uri, "getBusInfo", "/test") == [
            [0, "/a", "o", "TCPROS", "/chat", True],
            [0, a.uri, "i", "TCPROS", "/chat", True],
        ]
        assert await client.call(a.uri, "getBusStats", "/test") == [
            [["/chat", 5, [[0, 5, 1, True]]]],
            [["/chat", [[0, 5, 1, -1, True]]]],
            [],
        ]
