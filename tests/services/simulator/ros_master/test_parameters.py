from __future__ import annotations

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.ros1.errors import StatusError
from services.simulator.ros_master.parameters import ParameterTree, ParameterUpdate

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
    with pytest.raises(StatusError):
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


LIMIT = 10_000
FULL = LIMIT - 3 * 64 - len("a")  # less the root, the name and the value itself


def test_largest_tree_and_one_byte_more() -> None:
    parameters = ParameterTree(LIMIT)
    parameters.set("/a", "x" * FULL)
    with pytest.raises(StatusError, match=f"exceed {LIMIT} bytes"):
        parameters.set("/a", "x" * (FULL + 1))
    for key in ("/b", "/a/b", "/c/d/e"):
        with pytest.raises(StatusError):
            parameters.set(key, "x" * FULL)
    with pytest.raises(StatusError):
        parameters.set("/", {"a": "x" * FULL, "b": 1})
    assert parameters.names() == ["/a"]
    assert parameters.get("/a") == "x" * FULL


@pytest.mark.parametrize(
    "value", [[0] * (LIMIT // 64), {str(i): 0 for i in range(LIMIT // 128)}, {"x": "/".join("a" * 5000)}]
)
def test_whatever_a_value_is_made_of_counts(value: object) -> None:
    parameters = ParameterTree(LIMIT)
    with pytest.raises(StatusError):
        parameters.set("/a", value)
    assert parameters.names() == []


names = st.sampled_from("abc")
keys = st.lists(names, min_size=1, max_size=4).map("/".join)
values = st.recursive(
    st.text(max_size=9) | st.integers(), lambda inner: st.lists(inner) | st.dictionaries(names, inner), max_leaves=5
)


@given(st.lists(st.tuples(keys, st.none() | values)))
def test_what_was_replaced_or_deleted_makes_room_again(changes: list[tuple[str, object]]) -> None:
    """A value of None deletes."""
    parameters = ParameterTree(LIMIT)
    for key, value in changes:
        with suppress(LookupError):
            parameters.delete(key) if value is None else parameters.set(key, value)
    for name in list(parameters.get("/")):
        parameters.delete(name)
    parameters.set("/a", "x" * FULL)
    with pytest.raises(StatusError):
        parameters.set("/a", "x" * (FULL + 1))
