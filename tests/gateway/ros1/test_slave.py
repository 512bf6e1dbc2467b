from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import pytest

from gateway.ros1.errors import StatusError, UnknownMethodError
from gateway.ros1.slave import SlaveApi

if TYPE_CHECKING:
    from collections.abc import Sequence


class FakeNode:
    master_uri = "http://master:11311/"
    tcpros_address = ("robot", 5000)

    def __init__(self) -> None:
        self.updates: list[tuple[str, list[str]]] = []
        self.reasons: list[str] = []

    def publications(self) -> dict[str, str]:
        return {"/chat": "std_msgs/String"}

    def subscriptions(self) -> dict[str, str]:
        return {"/color": "sensor_msgs/Image"}

    def publishers_updated(self, topic: str, uris: Sequence[str]) -> None:
        self.updates.append((topic, list(uris)))

    def bus_stats(self) -> list[Any]:
        return [[["/chat", 2**40, []]], [], []]

    def bus_info(self) -> list[Any]:
        return [[0, "/peer", "o", "TCPROS", "/chat", True]]

    def shutdown(self, reason: str) -> None:
        self.reasons.append(reason)


@pytest.fixture
def node() -> FakeNode:
    return FakeNode()


def ask(node: FakeNode, method: str, *params: Any) -> Any:
    return SlaveApi(node).call(method, ("/caller", *params))[1]


def test_what_tools_ask(node: FakeNode) -> None:
    assert ask(node, "getPid") == os.getpid()
    assert ask(node, "getMasterUri") == "http://master:11311/"
    assert ask(node, "getPublications") == [["/chat", "std_msgs/String"]]
    assert ask(node, "getSubscriptions") == [["/color", "sensor_msgs/Image"]]
    assert ask(node, "getBusInfo") == [[0, "/peer", "o", "TCPROS", "/chat", True]]


def test_counts_are_cut_to_what_xmlrpc_can_say(node: FakeNode) -> None:
    assert ask(node, "getBusStats") == [[["/chat", 2**31 - 1, []]], [], []]


def test_topic_is_offered_over_tcpros(node: FakeNode) -> None:
    assert ask(node, "requestTopic", "/chat", [["UDPROS"], ["TCPROS"]]) == ["TCPROS", "robot", 5000]


@pytest.mark.parametrize(
    ("params", "code"),
    [
        (("/other", [["TCPROS"]]), -1),
        (("/chat", [["UDPROS"]]), 0),
        (("/chat", []), 0),
        (("/chat", ["TCPROS"]), 0),
        (("/chat", 5), -1),
        ((["/chat"], [["TCPROS"]]), -1),
        (("/chat",), -1),
        (("/chat", [["TCPROS"]], "more"), -1),
    ],
)
def test_topic_that_cannot_be_offered(node: FakeNode, params: tuple[Any, ...], code: int) -> None:
    with pytest.raises(StatusError) as error:
        ask(node, "requestTopic", *params)
    assert error.value.code == code


def test_whole_lists_of_publishers_are_passed_on(node: FakeNode) -> None:
    assert ask(node, "publisherUpdate", "/color", ["http://a/"]) == 0
    assert ask(node, "publisherUpdate", "/color", []) == 0
    assert node.updates == [("/color", ["http://a/"]), ("/color", [])]


@pytest.mark.parametrize(
    ("topic", "publishers"), [("/color", "http://a/"), ("/color", [1]), ("/color", {}), (False, []), ([], []), (5, [])]
)
def test_update_without_a_topic_and_a_list_of_publishers(node: FakeNode, topic: Any, publishers: Any) -> None:
    with pytest.raises(StatusError):
        ask(node, "publisherUpdate", topic, publishers)
    assert node.updates == []


def test_nothing_is_subscribed_to_parameters(node: FakeNode) -> None:
    with pytest.raises(StatusError) as error:
        ask(node, "paramUpdate", "/use_sim_time", 1)
    assert error.value.code == -1


def test_shutdown_is_passed_on(node: FakeNode) -> None:
    assert ask(node, "shutdown", "name taken") == 0
    assert ask(node, "shutdown") == 0
    assert node.reasons == ["name taken", ""]


@pytest.mark.parametrize("params", [(), (5,)])
def test_caller_has_to_say_its_name(node: FakeNode, params: tuple[Any, ...]) -> None:
    with pytest.raises(StatusError):
        SlaveApi(node).call("getPid", params)


def test_unknown_method(node: FakeNode) -> None:
    with pytest.raises(UnknownMethodError):
        ask(node, "selfDestruct")


@pytest.mark.parametrize("mistake", [KeyError, TypeError])
def test_mistake_in_a_method_is_not_the_callers(mistake: type[Exception]) -> None:
    class Mistaken(FakeNode):
        def shutdown(self, reason: str) -> None:
            raise mistake(reason)

    with pytest.raises(mistake, match="name taken"):
        ask(Mistaken(), "shutdown", "name taken")
