"""Masters that refuse; masters that come and go are in test_node.py."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from gateway.ros1.errors import StatusError
from gateway.ros1.node import Node
from gateway.ros1.xmlrpc.server import XmlRpcServer
from services.simulator.ros_master.master import RosMaster
from tests.waiting import until

if TYPE_CHECKING:
    import pytest

NOBODY = "http://127.0.0.1:9/"


class RefusingMaster:
    """Takes every topic but one."""

    def __init__(self, refused: str) -> None:
        self.refused = refused
        self.registered: list[str] = []
        self.attempts = 0

    def call(self, method: str, params: tuple[Any, ...]) -> tuple[str, Any]:
        if method == "registerPublisher":
            self.attempts += 1
            if params[1] == self.refused:
                raise StatusError(-1, "not that one")
            self.registered.append(params[1])
            return "", []
        if method == "getSystemState":
            return "", [[[topic, ["/a"]] for topic in self.registered], [], []]
        return "", 1


async def test_refused_registration_is_logged_once_and_keeps_no_other_from_being_made(
    caplog: pytest.LogCaptureFixture,
) -> None:
    master = RefusingMaster("/refused")
    async with (
        XmlRpcServer(master, host="127.0.0.1") as server,
        Node("/a", master_uri=server.uri, poll_interval=0.02) as node,
        node.advertise("/refused", "std_msgs/String"),
        node.advertise("/taken", "std_msgs/String"),
    ):
        await until(lambda: master.attempts >= 4, "the refused one is tried again")
        assert not node.registered
        assert master.registered == ["/taken"]
    assert caplog.text.count("/refused: the ROS master refuses us as a publisher: status -1: not that one") == 1


async def test_registration_that_is_taken_later_counts() -> None:
    master = RefusingMaster("/refused")
    async with (
        XmlRpcServer(master, host="127.0.0.1") as server,
        Node("/a", master_uri=server.uri, poll_interval=0.02) as node,
        node.advertise("/refused", "std_msgs/String"),
    ):
        await until(lambda: master.attempts, "it is refused")
        master.refused = ""
        await until(lambda: node.registered, "it is registered")


async def test_master_that_was_never_asked_with_success_does_not_answer(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    async with Node("/a", master_uri=NOBODY, poll_interval=100) as node:
        async with node.advertise("/chat", "std_msgs/String"):
            await until(lambda: node.master_answers is False, "it is known that nobody is there")
            node.shutdown("so that nothing is left to be called")
            async with node.advertise("/other", "std_msgs/String"):
                pass
        assert node.master_answers is False
    assert node.master_answers is False
    assert "answers" not in caplog.text


async def test_refusal_is_an_answer() -> None:
    async with (
        XmlRpcServer(RefusingMaster("/refused"), host="127.0.0.1") as server,
        Node("/a", master_uri=server.uri, poll_interval=100) as node,
        node.advertise("/refused", "std_msgs/String"),
    ):
        await until(lambda: node.master_answers, "it has answered")


async def test_looks_go_on_however_often_registrations_change() -> None:
    async with RosMaster() as master, Node("/a", master_uri=master.uri, poll_interval=0.05) as node:
        looks = node.looks()
        first = await anext(looks)
        assert (first.number, first.state.publishers, first.restarts) == (1, {}, 0)

        async def blink() -> None:
            while True:
                async with node.advertise("/chat", "std_msgs/String"):
                    await asyncio.sleep(0.005)

        blinking = asyncio.create_task(blink())
        async with asyncio.timeout(20):
            numbers = [(await anext(looks)).number for _ in range(3)]
        assert numbers == sorted(set(numbers))
        blinking.cancel()
        await asyncio.wait([blinking])


async def test_looks_show_who_comes_and_the_newest_is_there_for_who_asks_late() -> None:
    async with (
        RosMaster() as master,
        Node("/a", master_uri=master.uri, poll_interval=0.05) as node,
        Node("/b", master_uri=master.uri) as other,
        other.advertise("/chat", "std_msgs/String"),
    ):
        async for look in node.looks():
            if look.state.publishers:
                break
        assert look.state.publishers == {"/chat": ("/b",)}
        assert (await anext(node.looks())).number >= look.number


async def test_master_that_has_forgotten_the_node_was_restarted() -> None:
    master = RefusingMaster("/refused")
    async with (
        XmlRpcServer(master, host="127.0.0.1") as server,
        Node("/a", master_uri=server.uri, poll_interval=0.02) as node,
        node.advertise("/taken", "std_msgs/String"),
    ):
        await until(lambda: node.registered, "it is registered")
        looks = node.looks()
        before = await anext(looks)
        master.registered.clear()
        async with asyncio.timeout(20):
            async for look in looks:
                if look.restarts:
                    break
        assert (before.restarts, look.restarts) == (0, 1)
