"""What a ROS master does: the same suite for Debian's real one and for ours."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

import pytest

from gateway.ros1.errors import StatusError
from gateway.ros1.master import MasterClient
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.ros1.xmlrpc.server import XmlRpcServer
from services.simulator.ros_master.master import RosMaster
from tests.gateway.ros1.support.fakes import FakeSlave
from tests.integration.peers.ros import real_master, require_ros
from tests.waiting import until

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable
    from pathlib import Path
    from typing import TypeAlias

    Connect: TypeAlias = Callable[[str], MasterClient]

STRING = "std_msgs/String"
DEAD_URI = "http://127.0.0.1:9/"


@pytest.fixture(params=["embedded", "real"])
async def master_uri(request: pytest.FixtureRequest, tmp_path: Path) -> AsyncIterator[str]:
    if request.param == "embedded":
        async with RosMaster() as master:
            yield master.uri
    else:
        require_ros()
        async with real_master(tmp_path) as environment:
            yield environment.master_uri


@pytest.fixture
async def connect(master_uri: str) -> AsyncIterator[Connect]:
    async with XmlRpcClient() as client:
        yield lambda name: MasterClient(client, uri=master_uri, caller_id=name)


@asynccontextmanager
async def slave() -> AsyncIterator[tuple[str, list[tuple[str, tuple[Any, ...]]]]]:
    """Yield the URI of a node that answers everything, and the calls it got."""
    api = FakeSlave(lambda _method, _params: 0)
    async with XmlRpcServer(api, host="127.0.0.1") as server:
        yield server.uri, api.calls


async def test_fresh_master_knows_nobody(connect: Connect, master_uri: str) -> None:
    master = connect("/a")
    state = await master.get_system_state()
    assert (state.publishers, state.subscribers, state.services) == ({}, {}, {})
    assert await master.get_topic_types() == {}
    assert await master.get_pid() > 0
    assert (await master.call("getUri")).rpartition(":")[2] == master_uri.rpartition(":")[2]


async def test_registrations_show_in_the_state_until_unregistered(connect: Connect) -> None:
    a, b = connect("/a"), connect("/b")
    assert await a.register_publisher("/chat", STRING, DEAD_URI) == ()
    assert await b.register_subscriber("/chat", STRING, "http://127.0.0.1:10/") == (DEAD_URI,)
    state = await a.get_system_state()
    assert (state.publishers, state.subscribers) == ({"/chat": ("/a",)}, {"/chat": ("/b",)})
    assert await a.get_topic_types() == {"/chat": STRING}
    assert dict(await a.call("getPublishedTopics", "")) == {"/chat": STRING}
    assert await a.lookup_node("/a") == DEAD_URI
    assert await a.unregister_publisher("/chat", DEAD_URI) is True
    assert await a.unregister_publisher("/chat", DEAD_URI) is False
    assert await b.unregister_subscriber("/chat", "http://127.0.0.1:10/") is True
    state = await a.get_system_state()
    assert (state.publishers, state.subscribers) == ({}, {})
    assert dict(await a.call("getPublishedTopics", "")) == {}
    assert await a.get_topic_types() == {"/chat": STRING}


async def test_registering_twice_counts_once(connect: Connect) -> None:
    master = connect("/a")
    await master.register_publisher("/chat", STRING, DEAD_URI)
    await master.register_publisher("/chat", STRING, DEAD_URI)
    assert await connect("/b").register_subscriber("/chat", STRING, "http://127.0.0.1:10/") == (DEAD_URI,)


async def test_unregistering_somebody_else_does_nothing(connect: Connect) -> None:
    await connect("/a").register_publisher("/chat", STRING, DEAD_URI)
    assert await connect("/b").unregister_publisher("/chat", DEAD_URI) is False
    assert await connect("/a").unregister_publisher("/chat", "http://127.0.0.1:10/") is False
    assert (await connect("/a").get_system_state()).publishers == {"/chat": ("/a",)}


async def test_subscribers_are_told_the_whole_list_of_publishers(connect: Connect) -> None:
    async with slave() as (uri, calls):
        await connect("/listener").register_subscriber("/chat", STRING, uri)
        await connect("/a").register_publisher("/chat", STRING, DEAD_URI)
        await until(lambda: len(calls) == 1, "the first publisher is told")
        await connect("/b").register_publisher("/chat", STRING, "http://127.0.0.1:10/")
        await until(lambda: len(calls) == 2, "the second publisher is told")
        await connect("/a").unregister_publisher("/chat", DEAD_URI)
        await connect("/b").unregister_publisher("/chat", "http://127.0.0.1:10/")
        await until(lambda: calls[-1][1][2] == [], "the empty list is told")
    assert [method for method, _ in calls[:2]] == ["publisherUpdate", "publisherUpdate"]
    assert calls[0][1] == ("/master", "/chat", [DEAD_URI])
    assert calls[1][1] == ("/master", "/chat", [DEAD_URI, "http://127.0.0.1:10/"])


async def test_dead_subscriber_does_not_keep_a_live_one_from_being_told(connect: Connect) -> None:
    async with slave() as (uri, calls):
        await connect("/dead").register_subscriber("/chat", STRING, DEAD_URI)
        await connect("/listener").register_subscriber("/chat", STRING, uri)
        await connect("/a").register_publisher("/chat", STRING, "http://127.0.0.1:10/")
        await until(lambda: calls, "the live subscriber is told")
    assert calls == [("publisherUpdate", ("/master", "/chat", ["http://127.0.0.1:10/"]))]


async def test_node_whose_name_is_taken_is_shut_down_and_forgotten(connect: Connect) -> None:
    async with slave() as (uri, calls):
        await connect("/a").register_publisher("/old", STRING, uri)
        await connect("/a").register_publisher("/new", STRING, DEAD_URI)
        await until(lambda: calls, "the older node is told")
        state = await connect("/b").get_system_state()
    assert calls[0][0] == "shutdown"
    assert state.publishers == {"/new": ("/a",)}
    assert await connect("/b").lookup_node("/a") == DEAD_URI


async def test_unknown_node_and_service_are_errors(connect: Connect) -> None:
    with pytest.raises(StatusError) as error:
        await connect("/a").lookup_node("/nobody")
    assert error.value.code == -1
    with pytest.raises(StatusError):
        await connect("/a").call("lookupService", "/nothing")


@pytest.mark.parametrize("topic", ["", "no spaces", "/a:b"])
async def test_illegal_topic_is_refused(connect: Connect, topic: str) -> None:
    with pytest.raises(StatusError):
        await connect("/a").register_publisher(topic, STRING, DEAD_URI)


async def test_names_are_made_global_and_clean(connect: Connect) -> None:
    await connect("/ns/a").register_publisher("chat", STRING, DEAD_URI)
    await connect("/ns/a").register_publisher("//left//right/", STRING, DEAD_URI)
    await connect("/ns/a").register_publisher("/1/2d", STRING, DEAD_URI)
    assert set((await connect("/b").get_system_state()).publishers) == {"/ns/chat", "/left/right", "/1/2d"}


@pytest.mark.parametrize("uri", ["", "127.0.0.1:80", "nowhere"])
async def test_illegal_uri_is_refused(connect: Connect, uri: str) -> None:
    with pytest.raises(StatusError):
        await connect("/a").register_publisher("/chat", STRING, uri)


async def test_any_type_does_not_squash_a_type(connect: Connect) -> None:
    await connect("/a").register_subscriber("/chat", "*", DEAD_URI)
    assert await connect("/a").get_topic_types() == {}
    await connect("/a").register_publisher("/chat", STRING, DEAD_URI)
    await connect("/b").register_publisher("/chat", "*", "http://127.0.0.1:10/")
    assert await connect("/a").get_topic_types() == {"/chat": STRING}


async def test_parameters(connect: Connect) -> None:
    master = connect("/ns/a")
    await master.call("setParam", "/robot", {"name": "r1", "limits": {"speed": 0.5}})
    await master.call("setParam", "relative", [1, True, "x"])
    assert await master.call("getParam", "/robot/limits/speed") == 0.5
    assert await master.call("getParam", "/robot") == {"name": "r1", "limits": {"speed": 0.5}}
    assert await master.call("getParam", "/ns/relative") == [1, True, "x"]
    assert await master.call("hasParam", "/robot/name") is True
    assert await master.call("hasParam", "/robot/name/inside") is False
    assert set(await master.call("getParamNames")) == {"/robot/name", "/robot/limits/speed", "/ns/relative"}
    await master.call("deleteParam", "/robot/limits")
    assert await master.call("getParam", "/robot") == {"name": "r1"}


@pytest.mark.parametrize("key", ["/nothing", "/robot/name/inside"])
async def test_absent_parameter_is_an_error(connect: Connect, key: str) -> None:
    master = connect("/a")
    await master.call("setParam", "/robot/name", "r1")
    with pytest.raises(StatusError):
        await master.call("getParam", key)
    with pytest.raises(StatusError):
        await master.call("deleteParam", key)


async def test_search_goes_upwards(connect: Connect) -> None:
    master = connect("/ns/deep/a")
    await master.call("setParam", "/robot/name", "far")
    assert await master.call("searchParam", "robot/name") == "/robot/name"
    await master.call("setParam", "/ns/robot/model", "near")
    assert await master.call("searchParam", "robot/name") == "/ns/robot/name"
    with pytest.raises(StatusError):
        await master.call("searchParam", "nothing")


async def test_parameter_subscribers_are_told(connect: Connect) -> None:
    async with slave() as (uri, calls):
        assert await connect("/listener").call("subscribeParam", uri, "/robot/speed") == {}
        await connect("/a").call("setParam", "/robot/speed", 0.5)
        await until(lambda: len(calls) == 1, "the value is told")
        await connect("/a").call("setParam", "/robot", {"speed": 0.7})
        await until(lambda: len(calls) == 2, "the value within a namespace is told")
        await connect("/listener").call("unsubscribeParam", uri, "/robot/speed")
        await connect("/a").call("setParam", "/robot/speed", 0.9)
        await connect("/listener").register_subscriber("/chat", STRING, uri)
        await connect("/a").register_publisher("/chat", STRING, DEAD_URI)
        await until(lambda: calls[-1][0] == "publisherUpdate", "a later call has come")
    updates = [(params[1].rstrip("/"), params[2]) for method, params in calls if method == "paramUpdate"]
    assert updates == [("/robot/speed", 0.5), ("/robot/speed", 0.7)]


async def test_many_registrations_at_once(connect: Connect) -> None:
    names = [f"/node{i}" for i in range(20)]
    await asyncio.gather(*(connect(name).register_publisher("/chat", STRING, DEAD_URI) for name in names))
    assert set((await connect("/a").get_system_state()).publishers["/chat"]) == set(names)
