from __future__ import annotations

import pytest

from gateway.ros1.errors import StatusError
from services.simulator.ros_master import graph
from services.simulator.ros_master.graph import Graph, Registry, Replaced


def test_registry_keeps_order_and_forgets_empty_keys() -> None:
    registry = Registry()
    registry.add("/t", "/b", "http://b/")
    registry.add("/t", "/a", "http://a/")
    assert registry.uris("/t") == ["http://b/", "http://a/"]
    assert registry.state() == [["/t", ["/b", "/a"]]]
    assert registry.remove("/t", "/b", "http://b/")
    assert registry.remove("/t", "/a", "http://a/")
    assert registry.keys() == []


def test_only_this_very_registration_is_removed() -> None:
    registry = Registry()
    registry.add("/t", "/a", "http://new/")
    assert not registry.remove("/t", "/a", "http://old/")
    assert not registry.remove("/other", "/a", "http://new/")
    assert len(registry) == 1


def test_node_that_comes_back_at_another_uri_loses_what_it_had() -> None:
    book = Graph()
    assert book.join("/a", "http://old/") is None
    book.publishers.add("/t", "/a", "http://old/")
    book.subscribers.add("/s", "/a", "http://old/")
    assert book.join("/a", "http://old/") is None
    assert book.join("/a", "http://new/") == Replaced("/a", "http://old/", ("/t",))
    assert book.publishers.keys() == book.subscribers.keys() == []
    assert book.nodes == {"/a": "http://new/"}


def test_node_is_known_while_it_has_a_registration() -> None:
    book = Graph()
    book.join("/a", "http://a/")
    book.services.add("/s", "/a", "http://a/")
    book.leave("/a")
    assert "/a" in book.nodes
    book.services.remove("/s", "/a", "http://a/")
    book.leave("/a")
    assert "/a" not in book.nodes


def test_full_book_takes_nobody() -> None:
    book = Graph()
    for i in range(graph.MAX_REGISTRATIONS):
        book.publishers.add("/t", f"/n{i}", "http://n/")
    with pytest.raises(StatusError, match="over"):
        book.join("/late", "http://late/")


def test_types_of_topics() -> None:
    book = Graph()
    book.set_type("/t", "*", authoritative=False)
    assert book.topic_types == {}
    book.set_type("/t", "a/A", authoritative=False)
    book.set_type("/t", "b/B", authoritative=False)
    assert book.topic_types == {"/t": "a/A"}
    book.set_type("/t", "b/B", authoritative=True)
    book.set_type("/t", "*", authoritative=True)
    assert book.topic_types == {"/t": "b/B"}
    book.set_type("/any", "*", authoritative=True)
    assert book.topic_types["/any"] == "*"
