"""Subscriptions to publishers that fail; those to publishers that do not are in test_node.py."""

from __future__ import annotations

from contextlib import AsyncExitStack
from typing import Any

import pytest

from gateway.ros1.messages import message_type
from gateway.ros1.node import Node
from gateway.ros1.tcpros.subscriber import MAX_PUBLISHERS, LinkFailure, Message
from gateway.ros1.wire.header import encode_header
from gateway.ros1.wire.tcpros import message_prefix
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.ros1.xmlrpc.server import XmlRpcServer
from services.simulator.ros_master.master import RosMaster
from tests.gateway.ros1.support.fakes import FakeSlave, fake_publisher
from tests.gateway.ros1.support.nodes import node
from tests.waiting import until

STRING = "std_msgs/String"
DEAD_URI = "http://127.0.0.1:9/"


async def register(master: RosMaster, uri: str) -> None:
    """Register a slave URI as a publisher, in a name of its own."""
    async with XmlRpcClient() as client:
        name = f"/fake{uri.rstrip('/').rpartition(':')[2]}"
        await client.call(master.uri, "registerPublisher", name, "/chat", STRING, uri)


def stream(*messages: bytes) -> bytes:
    kind = message_type(STRING)
    header = encode_header({"type": kind.name, "md5sum": kind.md5sum, "callerid": "/fake"})
    return header + b"".join(message_prefix(len(message)) + message for message in messages)


@pytest.mark.parametrize(
    ("data", "failure"),
    [
        pytest.param(b"garbage" * 1000, LinkFailure.PROTOCOL, id="garbage"),
        pytest.param(stream(b"x" * 101), LinkFailure.TOO_LARGE, id="over the cap"),
        pytest.param(encode_header({"error": "go away"}), LinkFailure.REFUSED, id="refused"),
        pytest.param(encode_header({"type": "a/B", "md5sum": "0"}), LinkFailure.MISMATCH, id="mismatch"),
        pytest.param(stream(), LinkFailure.CLOSED, id="closed"),
    ],
)
async def test_failing_publisher_is_counted_and_tried_again(
    master: RosMaster, data: bytes, failure: LinkFailure
) -> None:
    async with (
        fake_publisher(data) as uri,
        node("/a", master) as a,
        a.subscribe("/chat", STRING, print, max_message_bytes=100) as subscription,
    ):
        await register(master, uri)
        await until(lambda: subscription.counters.failures[failure] >= 2, "it has failed twice")
        assert set(subscription.counters.failures) == {failure}
        assert subscription.counters.links[uri].failures[failure] >= 2


async def test_publisher_that_never_sends_its_header_is_given_up(master: RosMaster) -> None:
    async with (
        fake_publisher(b"", hang=True) as uri,
        Node("/a", master_uri=master.uri, timeout=0.1) as a,
        a.subscribe("/chat", STRING, print) as subscription,
    ):
        await register(master, uri)
        await until(lambda: subscription.counters.failures[LinkFailure.UNREACHABLE], "it is given up")


def stream_of(name: str, *messages: bytes) -> bytes:
    """What a publisher of any other type sends."""
    header = encode_header({"type": name, "md5sum": name[-1] * 32, "callerid": "/other"})
    return header + b"".join(message_prefix(len(message)) + message for message in messages)


async def test_a_subscription_to_any_type_hears_publishers_of_different_types(master: RosMaster) -> None:
    got: list[Message] = []
    async with (
        fake_publisher(stream(b"text"), hang=True) as text,
        fake_publisher(stream_of("a/B", b"other"), hang=True) as other,
        node("/a", master) as a,
        a.subscribe("/chat", "*", got.append) as subscription,
    ):
        await register(master, text)
        await until(lambda: got, "the first publisher is heard")
        assert subscription.type == message_type(STRING).topic_type
        await register(master, other)
        await until(lambda: len(got) == 2, "the second publisher is heard")
    assert [message.publisher.type.name for message in got] == [STRING, "a/B"]


async def test_a_publisher_of_a_type_that_is_not_accepted_costs_its_own_link_whoever_came_first(
    master: RosMaster, caplog: pytest.LogCaptureFixture
) -> None:
    got: list[Message] = []
    async with (
        fake_publisher(stream_of("a/B", b"wrong"), hang=True) as bad,
        fake_publisher(stream(b"right"), hang=True) as good,
        node("/a", master) as a,
        a.subscribe("/chat", "*", got.append, accepted=[STRING]) as subscription,
    ):
        await register(master, bad)
        await until(lambda: subscription.counters.failures[LinkFailure.MISMATCH] >= 2, "it is refused again")
        assert subscription.problems == [f"{bad}: type mismatch: /chat is a/B [{'B' * 32}], expected std_msgs/String"]
        await register(master, good)
        await until(lambda: got, "the other is heard")
        assert subscription.counters.links[good].problem == ""
    assert bytes(got[0].data) == b"right"
    assert len([line for line in caplog.messages if "type mismatch" in line]) == 1


async def test_another_version_of_a_type_is_told_by_its_md5sum(master: RosMaster) -> None:
    async with (
        fake_publisher(stream_of(STRING), hang=True) as bad,
        node("/a", master) as a,
        a.subscribe("/chat", STRING, print, accepted=[STRING]) as subscription,
    ):
        await register(master, bad)
        await until(lambda: subscription.problems, "it is refused")
        ours = message_type(STRING).md5sum
        assert subscription.problems[0].endswith(f"/chat is {STRING} [{'g' * 32}], expected [{ours}]")


async def test_what_does_not_fit_is_a_nearer_problem_than_what_is_not_there(master: RosMaster) -> None:
    async with (
        fake_publisher(stream_of("a/B")) as bad,
        node("/a", master) as a,
        a.subscribe("/chat", STRING, print) as subscription,
    ):
        await register(master, DEAD_URI)
        await register(master, bad)
        await until(lambda: len(subscription.problems) == 2, "both have failed")
        assert [problem.startswith(uri) for problem, uri in zip(subscription.problems, (bad, DEAD_URI), strict=True)]


async def test_a_connected_publisher_that_a_new_master_does_not_know_is_heard_until_it_goes() -> None:
    got: list[Message] = []
    gone: list[str] = []
    async with AsyncExitStack() as stack:
        async with RosMaster() as first:
            port = int(first.uri.rstrip("/").rpartition(":")[2])
            a = await stack.enter_async_context(Node("/a", master_uri=first.uri, poll_interval=0.05))
            subscription = await stack.enter_async_context(
                a.subscribe("/chat", STRING, got.append, on_gone=gone.append)
            )
            stubborn = await stack.enter_async_context(Node("/b", master_uri=first.uri, poll_interval=1000))
            await stack.enter_async_context(stubborn.subscribe("/other", STRING, print))
            leaving = AsyncExitStack()
            publication = await leaving.enter_async_context(stubborn.advertise("/chat", STRING))
            await until(lambda: publication.subscriber_count, "they are connected")
        await stack.enter_async_context(RosMaster(port=port))
        await until(lambda: subscription.listed() == [], "the new master has answered that it knows no publisher")
        publication.publish(b"still here")
        await until(lambda: got, "it is still heard")
        await leaving.aclose()
        await until(lambda: gone == [stubborn.uri], "it has gone for good")
        assert subscription.counters.links == {}


def unchanging(uris: list[str]) -> FakeSlave:
    """Answer as a master that knows the same publisher by name all along, wherever that is."""

    def answer(method: str, _params: tuple[Any, ...]) -> Any:
        if method == "getSystemState":
            return [[["/chat", ["/talker"]]], [["/chat", ["/a"]]], []]
        return list(uris) if method == "registerSubscriber" else 1

    return FakeSlave(answer)


async def test_namesake_at_another_uri_is_found_though_no_update_tells_of_it() -> None:
    """The master lists one publisher all along, so that its number says nothing."""
    got: list[Message] = []
    uris = [DEAD_URI]
    async with (
        fake_publisher(stream(b"moved"), hang=True) as uri,
        XmlRpcServer(unchanging(uris), host="127.0.0.1") as master,
        Node("/a", master_uri=master.uri, poll_interval=0.05) as a,
        a.subscribe("/chat", STRING, got.append) as subscription,
    ):
        await until(lambda: subscription.counters.failures, "the old URI has failed")
        uris[:] = [uri]
        await until(lambda: got, "the publisher is heard at its new URI")


async def test_namesake_is_found_though_the_replaced_publisher_stays_connected() -> None:
    got: list[Message] = []
    uris: list[str] = []
    async with (
        fake_publisher(stream(b"old"), hang=True) as old,
        fake_publisher(stream(b"new"), hang=True) as new,
        XmlRpcServer(unchanging(uris), host="127.0.0.1") as master,
        Node("/a", master_uri=master.uri, poll_interval=0.02) as a,
    ):
        uris[:] = [old]
        async with a.subscribe("/chat", STRING, got.append) as subscription:
            await until(lambda: got, "the publisher is heard")
            uris[:] = [new]
            await until(lambda: len(got) == 2, "its namesake is heard")
            assert subscription.counters.links[old].connected
            assert subscription.counters.failures.total() == 0


@pytest.mark.parametrize("answer", [[], 0, ["UDPROS", "127.0.0.1", 1], ["TCPROS", "", 1], ["TCPROS", "127.0.0.1", 0]])
async def test_publisher_that_offers_no_tcpros_is_tried_again(master: RosMaster, answer: object) -> None:
    slave = FakeSlave(lambda _method, _params: answer)
    async with (
        XmlRpcServer(slave, host="127.0.0.1") as server,
        node("/a", master) as a,
        a.subscribe("/chat", STRING, print) as subscription,
    ):
        await register(master, server.uri)
        await until(lambda: subscription.counters.failures[LinkFailure.UNREACHABLE] >= 2, "it has failed twice")
    assert slave.calls[0] == ("requestTopic", ("/a", "/chat", [["TCPROS"]]))


@pytest.mark.parametrize("host", ["robot..lan", "x" * 64, "no-such-host.invalid"])
async def test_publisher_at_a_host_that_cannot_be_one_costs_its_own_link(master: RosMaster, host: str) -> None:
    slave = FakeSlave(lambda _method, _params: ["TCPROS", host, 4000])
    async with (
        XmlRpcServer(slave, host="127.0.0.1") as server,
        node("/a", master) as a,
        a.subscribe("/chat", STRING, print) as subscription,
    ):
        await register(master, server.uri)
        await until(lambda: subscription.counters.failures[LinkFailure.UNREACHABLE] >= 2, "it has failed twice")


async def test_the_address_of_a_publisher_is_one_line_of_a_problem(master: RosMaster) -> None:
    async with node("/a", master) as a, a.subscribe("/chat", STRING, print) as subscription:
        await until(lambda: a.registered, "the master's own list has come")
        a.publishers_updated("/chat", ["a\n\x1bb"])
        await until(lambda: subscription.problems, "it has failed")
        assert subscription.problems == ["a ?b: unreachable: a ?b requestTopic: not the address of an HTTP server"]


async def test_number_of_links_is_bounded(master: RosMaster) -> None:
    async with node("/a", master) as a, a.subscribe("/chat", STRING, print) as subscription:
        a.publishers_updated("/chat", [f"http://127.0.0.1:9/{i}" for i in range(MAX_PUBLISHERS + 1)])
        assert len(subscription.counters.links) == MAX_PUBLISHERS
        a.publishers_updated("/chat", [])
        assert len(subscription.counters.links) == 0
