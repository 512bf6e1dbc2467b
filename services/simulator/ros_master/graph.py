"""The master's registry of nodes and their topics and services, without I/O. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.ros1.errors import StatusError

MAX_REGISTRATIONS = 20_000


@dataclass(frozen=True, slots=True)
class Replaced:
    """A node whose name was taken over by another."""

    name: str
    uri: str
    published: tuple[str, ...]


class Registry:
    """Node names and their slave URIs, by topic or service."""

    def __init__(self) -> None:
        self._entries: dict[str, dict[str, str]] = {}

    def __len__(self) -> int:
        return sum(len(nodes) for nodes in self._entries.values())

    def add(self, key: str, node: str, uri: str) -> None:
        self._entries.setdefault(key, {})[node] = uri

    def remove(self, key: str, node: str, uri: str) -> bool:
        """Remove a registration; return whether exactly this one existed."""
        nodes = self._entries.get(key, {})
        if nodes.get(node) != uri:
            return False
        del nodes[node]
        if not nodes:
            del self._entries[key]
        return True

    def remove_node(self, node: str) -> list[str]:
        """Remove a node; return the keys it was registered for."""
        keys = [key for key, nodes in self._entries.items() if node in nodes]
        for key in keys:
            self.remove(key, node, self._entries[key][node])
        return keys

    def has_node(self, node: str) -> bool:
        return any(node in nodes for nodes in self._entries.values())

    def keys(self) -> list[str]:
        return list(self._entries)

    def nodes(self, key: str) -> list[str]:
        return list(self._entries.get(key, {}))

    def uris(self, key: str) -> list[str]:
        return list(self._entries.get(key, {}).values())

    def state(self) -> list[list[object]]:
        """Return `[[key, [node...]]...]` as getSystemState has it."""
        return [[key, list(nodes)] for key, nodes in self._entries.items()]


class Graph:
    """All registrations at one master; a node is known while it has any."""

    def __init__(self) -> None:
        self.publishers = Registry()
        self.subscribers = Registry()
        self.services = Registry()
        self.topic_types: dict[str, str] = {}
        self.nodes: dict[str, str] = {}

    def join(self, node: str, uri: str) -> Replaced | None:
        """Register a node by its slave URI; a node with the same name and another URI loses everything.

        Raises:
            StatusError: the book is full.

        """
        size = len(self.publishers) + len(self.subscribers) + len(self.services)
        if size >= MAX_REGISTRATIONS or len(self.topic_types) > MAX_REGISTRATIONS:
            raise StatusError(0, f"over {MAX_REGISTRATIONS} registrations")
        old = self.nodes.get(node)
        self.nodes[node] = uri
        if old is None or old == uri:
            return None
        published = self.publishers.remove_node(node)
        self.subscribers.remove_node(node)
        self.services.remove_node(node)
        return Replaced(node, old, tuple(published))

    def leave(self, node: str) -> None:
        """Forget a node without any registration left."""
        if not any(book.has_node(node) for book in (self.publishers, self.subscribers, self.services)):
            self.nodes.pop(node, None)

    def set_type(self, topic: str, type_name: str, *, authoritative: bool) -> None:
        """Set a topic's type: a publisher's overrides, a subscriber's counts only if there is none, `*` never."""
        if type_name == "*":
            if authoritative:
                self.topic_types.setdefault(topic, type_name)
        elif authoritative or topic not in self.topic_types:
            self.topic_types[topic] = type_name
