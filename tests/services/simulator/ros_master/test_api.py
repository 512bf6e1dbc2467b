"""What the contract suite cannot ask of a real master; the rest is in tests/contract/test_ros_master.py."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.ros1.errors import StatusError, UnknownMethodError
from services.simulator.ros_master.api import MasterApi
from services.simulator.ros_master.parameters import MAX_PARAMETER_BYTES

URI = "http://127.0.0.1:1/"
OTHER = "http://127.0.0.1:2/"


class RecordingNotifier:
    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []

    def notify(self, uri: str, method: str, key: str, *params: Any) -> None:
        self.calls.append((uri, method, key, *params))


@pytest.fixture
def notifier() -> RecordingNotifier:
    return RecordingNotifier()


@pytest.fixture
def api(notifier: RecordingNotifier) -> MasterApi:
    return MasterApi(notifier)


def test_services(api: MasterApi) -> None:
    api.call("registerService", ("/a", "/add", "rosrpc://127.0.0.1:5", URI))
    assert api.call("lookupService", ("/x", "/add"))[1] == "rosrpc://127.0.0.1:5"
    api.call("registerService", ("/b", "/add", "rosrpc://127.0.0.1:6", OTHER))
    assert api.call("lookupService", ("/x", "/add"))[1] == "rosrpc://127.0.0.1:6"
    assert api.call("getSystemState", ("/x",))[1] == [[], [], [["/add", ["/b"]]]]
    assert api.call("unregisterService", ("/a", "/add", "rosrpc://127.0.0.1:5"))[1] == 0
    assert api.call("unregisterService", ("/b", "/add", "rosrpc://127.0.0.1:6"))[1] == 1
    with pytest.raises(StatusError):
        api.call("lookupService", ("/x", "/add"))
    with pytest.raises(StatusError):
        api.call("lookupNode", ("/x", "/b"))


@pytest.mark.parametrize(
    ("method", "what"),
    [
        ("registerPublisher", ("/chat", "no type")),
        ("registerPublisher", ("/chat", ["a/A"])),
        ("registerSubscriber", ("/chat", "no type")),
        ("registerService", ("/chat", "no URI")),
    ],
)
def test_who_is_refused_is_not_registered(
    api: MasterApi, notifier: RecordingNotifier, method: str, what: tuple[Any, ...]
) -> None:
    api.call("registerSubscriber", ("/listener", "/else", "a/A", OTHER))
    before = api.call("getSystemState", ("/x",))
    with pytest.raises(StatusError):
        api.call(method, ("/a", *what, URI))
    with pytest.raises(StatusError):
        api.call(method, ("/listener", *what, URI))
    assert api.call("getSystemState", ("/x",)) == before
    assert api.call("getPublishedTopics", ("/x", ""))[1] == []
    assert notifier.calls == []


def test_taking_a_name_tells_the_older_node_and_its_subscribers(api: MasterApi, notifier: RecordingNotifier) -> None:
    api.call("registerSubscriber", ("/listener", "/chat", "a/A", OTHER))
    api.call("registerPublisher", ("/a", "/chat", "a/A", URI))
    notifier.calls.clear()
    api.call("registerPublisher", ("/a", "/else", "a/A", "http://127.0.0.1:3/"))
    assert notifier.calls == [
        (URI, "shutdown", "", "[/a] new node registered with same name"),
        (OTHER, "publisherUpdate", "/chat", "/chat", []),
    ]


@pytest.mark.parametrize(
    ("method", "params"),
    [
        ("registerPublisher", ("/a",)),
        ("registerPublisher", ("/a", "/chat", "no type", URI)),
        ("registerPublisher", ("relative", "/chat", "a/A", URI)),
        ("registerPublisher", ("/a", 5, "a/A", URI)),
        ("registerPublisher", ("/a", "/chat", "a/A", 5)),
        ("registerPublisher", ("/a", "/chat", "a/A", URI, "more")),
        ("hasParam", ("/a", 5)),
        ("setParam", ("/a", "", 1)),
        ("setParam", ("/a", "/", 1)),
        ("getParam", ("/a", "no spaces")),
        ("searchParam", ("relative", "x")),
        ("getSystemState", ()),
        ("getSystemState", (5,)),
    ],
)
def test_wrong_parameters_are_the_callers_error(api: MasterApi, method: str, params: tuple[Any, ...]) -> None:
    with pytest.raises(StatusError) as error:
        api.call(method, params)
    assert error.value.code == -1


def test_parameters_over_the_limit_are_refused_with_a_reason(api: MasterApi) -> None:
    api.call("setParam", ("/a", "/small", 1))
    with pytest.raises(StatusError, match=str(MAX_PARAMETER_BYTES)) as error:
        api.call("setParam", ("/a", "/big", "x" * MAX_PARAMETER_BYTES))
    assert error.value.code == 0
    assert api.call("getParam", ("/a", "/"))[1] == {"small": 1}


def test_published_topics_within_a_namespace(api: MasterApi) -> None:
    for topic in ("/ns/a", "/ns/b/c", "/nsx/d"):
        api.call("registerPublisher", ("/n", topic, "a/A", URI))
    found = [topic for topic, _ in api.call("getPublishedTopics", ("/n", "/ns"))[1]]
    assert found == ["/ns/a", "/ns/b/c"]


def test_unknown_method(api: MasterApi) -> None:
    with pytest.raises(UnknownMethodError):
        api.call("selfDestruct", ("/a",))


@pytest.mark.parametrize("mistake", [AttributeError, KeyError, TypeError])
def test_mistake_in_a_method_is_not_the_callers(mistake: type[Exception]) -> None:
    class Mistaken:
        def notify(self, _uri: str, _method: str, key: str, *_params: Any) -> None:
            raise mistake(key)

    api = MasterApi(Mistaken())
    api.call("registerSubscriber", ("/listener", "/chat", "a/A", OTHER))
    with pytest.raises(mistake, match="/chat"):
        api.call("registerPublisher", ("/a", "/chat", "a/A", URI))
