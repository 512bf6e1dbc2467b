from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

from gateway.ros1.errors import StatusError
from gateway.ros1.node import Node
from gateway.ros1.resolver import Resolver
from gateway.ros1.slave import MAX_NAMED, MasterCalls
from gateway.ros1.xmlrpc.client import XmlRpcClient
from tests.gateway.ros1.test_resolver import Names, names
from tests.waiting import until

if TYPE_CHECKING:
    from services.simulator.ros_master.master import RosMaster

__all__ = ["names"]
AWAY = "203.0.113.1"
METHODS = ("publisherUpdate", "shutdown", "paramUpdate")


async def calls_of(host: str) -> MasterCalls:
    """Return the check of a node whose master's host was looked up once."""
    resolver = Resolver()
    calls = MasterCalls(f"http://{host}:11311", resolver)
    await resolver.addresses(host)
    return calls


def refused(calls: MasterCalls, peer: str, method: str = "shutdown") -> bool:
    """Return whether a call is refused."""
    before = calls.refused
    with suppress(StatusError):
        calls.check(peer, method)
    return calls.refused > before


@pytest.mark.parametrize("method", METHODS)
async def test_all_addresses_of_the_master_s_name_may_call_and_no_other_one(names: Names, method: str) -> None:
    names.known["robot"] = ["203.0.113.1", "203.0.113.2", "fe80::7%eth0"]
    calls = await calls_of("robot")
    admitted = ("203.0.113.1", "203.0.113.2", "::ffff:203.0.113.2", "fe80::7", "fe80::7%wlan0")
    assert not any(refused(calls, peer, method) for peer in admitted)
    assert all(refused(calls, peer, method) for peer in ("203.0.113.3", "127.0.0.1", "::1", "fe80::8"))


async def test_beside_its_master_all_addresses_of_the_machine_may_call() -> None:
    calls = await calls_of("127.0.0.1")
    assert not refused(calls, "127.0.0.1")
    assert not refused(calls, "127.0.0.2")
    assert refused(calls, AWAY)


async def test_a_name_with_an_address_of_this_machine_is_beside_it(names: Names) -> None:
    names.known["robot"] = [AWAY, "127.0.1.1"]
    calls = await calls_of("robot")
    assert not refused(calls, "127.0.0.1")
    assert refused(calls, "203.0.113.9")


async def test_the_rest_of_the_slave_api_is_everybody_s() -> None:
    calls = await calls_of(AWAY)
    for method in ("requestTopic", "getPid", "getBusInfo", "getMasterUri", "nothing"):
        assert not refused(calls, "203.0.113.9", method)


async def test_a_master_that_has_moved_is_followed(names: Names) -> None:
    resolver = Resolver()
    calls = MasterCalls("http://robot:11311", resolver)
    assert refused(calls, AWAY)
    for address, other in ((AWAY, "203.0.113.2"), ("203.0.113.2", AWAY)):
        names.known["robot"] = [address]
        await resolver.addresses("robot")
        assert not refused(calls, address)
        assert refused(calls, other)


async def test_refused_calls_are_counted_and_each_address_is_named_once(caplog: pytest.LogCaptureFixture) -> None:
    calls = await calls_of(AWAY)
    for _ in range(3):
        refused(calls, "203.0.113.7")
    refused(calls, "203.0.113.8")
    assert calls.refused == 4
    assert (
        caplog.text.count("203.0.113.7 called shutdown, which is for the ROS master at http://203.0.113.1:11311") == 1
    )
    assert caplog.text.count("203.0.113.8 called") == 1
    for number in range(2 * MAX_NAMED):
        refused(calls, f"198.51.100.{number}")
    assert caplog.text.count("called shutdown") == MAX_NAMED


async def test_a_node_takes_no_publishers_and_no_end_from_another_machine() -> None:
    async with (
        Node("/a", master_uri=f"http://{AWAY}:9", poll_interval=100, timeout=0.2) as node,
        node.subscribe("/chat", "std_msgs/String", print) as subscription,
        XmlRpcClient() as client,
    ):
        with pytest.raises(StatusError, match="is taken from the ROS master's addresses only") as error:
            await client.call(node.uri, "shutdown", "/master", "because")
        assert error.value.code == -1
        with pytest.raises(StatusError, match="publisherUpdate is taken from"):
            await client.call(node.uri, "publisherUpdate", "/master", "/chat", ["http://127.0.0.1:9/"])
        assert await client.call(node.uri, "getMasterUri", "/other") == f"http://{AWAY}:9"
        assert not node.shutdown_requested.is_set()
        assert subscription.counters.links == {}
        assert node.master_calls.refused == 2


async def test_a_master_by_name_is_heard(master: RosMaster, names: Names) -> None:
    names.known |= {"127.0.0.1": ["127.0.0.1"]}
    port = master.uri.rstrip("/").rpartition(":")[2]
    async with (
        Node("/a", master_uri=f"http://robot:{port}", poll_interval=100) as a,
        Node("/b", master_uri=f"http://robot:{port}", poll_interval=100) as b,
        a.subscribe("/chat", "std_msgs/String", print) as subscription,
    ):
        await until(lambda: a.registered, "it is registered")
        async with b.advertise("/chat", "std_msgs/String"):
            await until(lambda: list(subscription.counters.links) == [b.uri], "its master has told of the publisher")
        assert a.master_calls.refused == 0


async def test_a_master_that_calls_from_an_unknown_address_is_asked_instead(
    master: RosMaster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(MasterCalls, "_is_master", lambda *_: False)
    async with (
        Node("/a", master_uri=master.uri, poll_interval=0.1) as a,
        Node("/b", master_uri=master.uri) as b,
        a.subscribe("/chat", "std_msgs/String", print) as subscription,
    ):
        await until(lambda: a.registered, "it is registered")
        async with b.advertise("/chat", "std_msgs/String"):
            await until(lambda: list(subscription.counters.links) == [b.uri], "the publisher is found")
        await until(lambda: not subscription.counters.links, "that it has left is found")
        assert a.master_calls.refused == 2
