"""What the client makes of answers that no master should give; the rest is in tests/contract/test_ros_master.py."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.ros1.errors import XmlRpcError
from gateway.ros1.master import MasterClient, SystemState
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.ros1.xmlrpc.server import XmlRpcServer
from tests.gateway.ros1.support.fakes import FakeSlave


async def ask(method: str, *arguments: Any, answer: Any) -> Any:
    api = FakeSlave(lambda _method, _params: answer)
    async with XmlRpcServer(api, host="127.0.0.1") as server, XmlRpcClient() as client:
        return await getattr(MasterClient(client, uri=server.uri, caller_id="/a"), method)(*arguments)


async def test_system_state() -> None:
    state = await ask("get_system_state", answer=[[["/t", ["/a", "/b"]]], [], [["/s", ["/a"]]]])
    assert state == SystemState({"/t": ("/a", "/b")}, {}, {"/s": ("/a",)})
    assert state.nodes() == {"/a", "/b"}


@pytest.mark.parametrize(
    ("method", "arguments", "answer"),
    [
        ("get_system_state", (), 0),
        ("get_system_state", (), [[], []]),
        ("get_system_state", (), [[["/t"]], [], []]),
        ("get_system_state", (), [[["/t", "/a"]], [], []]),
        ("get_system_state", (), [[["/t", [1]]], [], []]),
        ("register_subscriber", ("/t", "a/A", "http://a/"), "http://b/"),
        ("register_subscriber", ("/t", "a/A", "http://a/"), [5]),
        ("unregister_publisher", ("/t", "http://a/"), "1"),
        ("lookup_node", ("/b",), 5),
        ("get_pid", (), "5"),
        ("get_topic_types", (), 0),
        ("get_topic_types", (), [["/t"]]),
        ("get_topic_types", (), [["/t", 5]]),
    ],
)
async def test_answer_of_another_kind_is_an_error(method: str, arguments: tuple[Any, ...], answer: Any) -> None:
    with pytest.raises(XmlRpcError):
        await ask(method, *arguments, answer=answer)


@pytest.mark.parametrize(("value", "used"), [(True, True), (1, True), (False, False), (0, False), ("", False)])
async def test_simulated_time_is_used_where_rospy_would(value: object, used: bool) -> None:  # noqa: FBT001 - a case
    assert await ask("uses_sim_time", answer=value) is used
