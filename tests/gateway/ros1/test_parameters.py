from __future__ import annotations

import pytest

from gateway.ros1.parameters import ParameterTree, ParameterUpdate

URI = "http://127.0.0.1:1/"


def tree(**values: object) -> ParameterTree:
    parameters = ParameterTree()
    parameters.set("/", values)
    return parameters


def test_namespace_is_a_dict() -> None:
    parameters = tree()
    parameters.set("/a/b/c", 1)
    assert parameters.get("/a") == {"b": {"c": 1}}
    assert parameters.get("/") == {"a": {"b": {"c": 1}}}


def test_plain_value_gives_way_to_a_namespace() -> None:
    parameters = tree(a=1)
    parameters.set("/a/b", 2)
    assert parameters.get("/a") == {"b": 2}


def test_setting_replaces_a_namespace() -> None:
    parameters = tree(a={"b": 1, "c": 2})
    parameters.set("/a", {"b": 3})
    assert parameters.get("/a") == {"b": 3}


def test_root_is_a_namespace() -> None:
    with pytest.raises(TypeError):
        tree().set("/", 5)
    with pytest.raises(LookupError):
        tree(a=1).delete("/")


@pytest.mark.parametrize("key", ["/b", "/a/b", "/ns/x"])
def test_what_is_not_there(key: str) -> None:
    parameters = tree(a=1, ns={"y": 2})
    assert not parameters.has(key)
    with pytest.raises(LookupError):
        parameters.get(key)
    with pytest.raises(LookupError):
        parameters.delete(key)


def test_names_are_those_of_values() -> None:
    assert tree(a=1, b={"c": 2, "d": {"e": 3}}, empty={}).names() == ["/a", "/b/c", "/b/d/e"]


def test_search_finds_the_nearest() -> None:
    parameters = tree(speed=1, ns={"speed": 2, "deep": {"other": 3}})
    assert parameters.search("speed", "/ns/deep/node") == "/ns/speed"
    assert parameters.search("speed", "/node") == "/speed"
    assert parameters.search("/speed", "/ns/node") == "/speed"
    assert parameters.search("/nothing", "/ns/node") is None
    assert parameters.search("nothing", "/ns/node") is None


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("/a", 5, ("/a", 5)),
        ("/a/b", 5, ("/a/b", 5)),
        ("/", {"a": 5}, ("/a", 5)),
        ("/", {"x": 5}, ("/a", {})),
    ],
)
def test_subscriber_is_told(key: str, value: object, told: tuple[str, object]) -> None:
    parameters = tree(a=1)
    assert parameters.subscribe("/a/", "/listener", URI) == 1
    assert parameters.set(key, value, "/somebody") == [ParameterUpdate(URI, *told)]


def test_subscriber_is_not_told_of_its_own_or_of_other_changes() -> None:
    parameters = tree()
    assert parameters.subscribe("/a", "/listener", URI) == {}
    assert parameters.set("/a", 1, "/listener") == []
    assert parameters.set("/ab", 1, "/somebody") == []


def test_deleting_is_told() -> None:
    parameters = tree(a=1)
    parameters.subscribe("/a", "/listener", URI)
    assert parameters.delete("/a") == [ParameterUpdate(URI, "/a", {})]


def test_unsubscribed_is_not_told() -> None:
    parameters = tree(a=1)
    parameters.subscribe("/a", "/listener", URI)
    parameters.subscribe("/b", "/listener", URI)
    assert parameters.subscription_count == 2
    assert parameters.unsubscribe("/a", URI)
    assert not parameters.unsubscribe("/a", URI)
    parameters.forget(URI)
    assert parameters.subscription_count == 0
    assert parameters.set("/", {}, "/somebody") == []
