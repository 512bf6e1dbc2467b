"""The master API for nodes and tools; its calls back to nodes are queued for a notifier."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Protocol

from gateway.ros1.errors import ERROR, InvalidNameError, StatusError
from gateway.ros1.names import resolve, validate_global, validate_type
from gateway.ros1.xmlrpc.methods import Methods
from services.simulator.ros_master.graph import Graph
from services.simulator.ros_master.parameters import ParameterTree

if TYPE_CHECKING:
    from collections.abc import Iterable

    from services.simulator.ros_master.parameters import ParameterUpdate

MAX_PARAMETER_SUBSCRIPTIONS = 20_000


class Notifier(Protocol):
    """Queues calls to nodes; a newer call with the same node, method and key replaces an older one."""

    def notify(self, uri: str, method: str, key: str, *params: Any) -> None: ...


class MasterApi:
    """Answers calls of the master API; the first parameter of each is the caller's name."""

    def __init__(self, notifier: Notifier) -> None:
        self.uri = ""
        self._notifier = notifier
        self._graph = Graph()
        self._services: dict[str, tuple[str, str]] = {}
        self._parameters = ParameterTree()
        self._methods = Methods(
            {
                "registerPublisher": self._register_publisher,
                "unregisterPublisher": self._unregister_publisher,
                "registerSubscriber": self._register_subscriber,
                "unregisterSubscriber": self._unregister_subscriber,
                "registerService": self._register_service,
                "unregisterService": self._unregister_service,
                "lookupNode": self._lookup_node,
                "lookupService": self._lookup_service,
                "getPublishedTopics": self._get_published_topics,
                "getTopicTypes": lambda _: ("topic types", [list(item) for item in self._graph.topic_types.items()]),
                "getSystemState": self._get_system_state,
                "getUri": lambda _: ("", self.uri),
                "getPid": lambda _: ("", os.getpid()),
                "getParam": self._get_param,
                "setParam": self._set_param,
                "hasParam": self._has_param,
                "deleteParam": self._delete_param,
                "searchParam": self._search_param,
                "getParamNames": lambda _: ("parameter names", self._parameters.names()),
                "subscribeParam": self._subscribe_param,
                "unsubscribeParam": self._unsubscribe_param,
            }
        )

    def call(self, method: str, params: tuple[Any, ...]) -> tuple[str, Any]:
        """Answer one call; raises StatusError or UnknownMethodError as the server expects."""
        try:
            return self._methods.call(method, params)
        except InvalidNameError as error:
            raise StatusError(ERROR, str(error)) from error

    def _register_publisher(self, caller: str, topic: str, type_name: str, uri: str) -> tuple[str, Any]:
        kind = _type(type_name)
        topic = self._join(caller, topic, uri)
        self._graph.publishers.add(topic, caller, uri)
        self._graph.set_type(topic, kind, authoritative=True)
        self._tell_subscribers([topic])
        return f"registered {caller} as publisher of {topic}", self._graph.subscribers.uris(topic)

    def _unregister_publisher(self, caller: str, topic: str, uri: str) -> tuple[str, Any]:
        topic = resolve(topic, caller)
        removed = self._graph.publishers.remove(topic, caller, uri)
        self._graph.leave(caller)
        if removed:
            self._tell_subscribers([topic])
        return "unregistered" if removed else f"{caller} is not a publisher of {topic}", int(removed)

    def _register_subscriber(self, caller: str, topic: str, type_name: str, uri: str) -> tuple[str, Any]:
        kind = _type(type_name)
        topic = self._join(caller, topic, uri)
        self._graph.subscribers.add(topic, caller, uri)
        self._graph.set_type(topic, kind, authoritative=False)
        return f"subscribed to {topic}", self._graph.publishers.uris(topic)

    def _unregister_subscriber(self, caller: str, topic: str, uri: str) -> tuple[str, Any]:
        topic = resolve(topic, caller)
        removed = self._graph.subscribers.remove(topic, caller, uri)
        self._graph.leave(caller)
        return "unregistered" if removed else f"{caller} is not a subscriber of {topic}", int(removed)

    def _register_service(self, caller: str, service: str, service_uri: str, uri: str) -> tuple[str, Any]:
        service_uri = _uri(service_uri)
        service = self._join(caller, service, uri)
        for other in self._graph.services.nodes(service):
            self._graph.services.remove(service, other, self._graph.nodes.get(other, ""))
            self._graph.leave(other)
        self._graph.nodes[caller] = uri
        self._graph.services.add(service, caller, uri)
        self._services[service] = (caller, service_uri)
        return f"registered {caller} as provider of {service}", 1

    def _unregister_service(self, caller: str, service: str, service_uri: str) -> tuple[str, Any]:
        service = resolve(service, caller)
        if self._services.get(service) != (caller, service_uri):
            return f"{caller} does not provide {service} at {service_uri}", 0
        del self._services[service]
        self._graph.services.remove(service, caller, self._graph.nodes[caller])
        self._graph.leave(caller)
        return "unregistered", 1

    def _lookup_node(self, caller: str, name: str) -> tuple[str, Any]:
        uri = self._graph.nodes.get(resolve(name, caller))
        if uri is None:
            raise StatusError(ERROR, f"unknown node {name}", "")
        return "node api", uri

    def _lookup_service(self, caller: str, name: str) -> tuple[str, Any]:
        service = resolve(name, caller)
        if service not in self._services:
            raise StatusError(ERROR, "no provider", "")
        return "rosrpc URI", self._services[service][1]

    def _get_published_topics(self, caller: str, subgraph: str) -> tuple[str, Any]:
        within = f"{resolve(subgraph, caller)}/" if subgraph.strip("/") else "/"
        topics = [topic for topic in self._graph.publishers.keys() if topic.startswith(within)]  # noqa: SIM118
        return "current topics", [[topic, self._graph.topic_types[topic]] for topic in topics]

    def _get_system_state(self, _caller: str) -> tuple[str, Any]:
        books = (self._graph.publishers, self._graph.subscribers, self._graph.services)
        return "current system state", [book.state() for book in books]

    def _get_param(self, caller: str, key: str) -> tuple[str, Any]:
        try:
            return f"parameter {key}", self._parameters.get(_key(key, caller))
        except LookupError as error:
            raise StatusError(ERROR, f"parameter {key} is not set") from error

    def _set_param(self, caller: str, key: str, value: Any) -> tuple[str, Any]:
        self._tell_parameters(self._parameters.set(_key(key, caller), value, caller))
        return f"parameter {key} set", 0

    def _has_param(self, caller: str, key: str) -> tuple[str, Any]:
        return key, self._parameters.has(_key(key, caller))

    def _delete_param(self, caller: str, key: str) -> tuple[str, Any]:
        try:
            updates = self._parameters.delete(_key(key, caller))
        except LookupError as error:
            raise StatusError(ERROR, f"parameter {key} is not set") from error
        self._tell_parameters(updates)
        return f"parameter {key} deleted", 0

    def _search_param(self, caller: str, key: str) -> tuple[str, Any]:
        found = self._parameters.search(key, validate_global(caller))
        if found is None:
            raise StatusError(ERROR, f"parameter {key} is not set in any enclosing namespace", "")
        return f"found {found}", found

    def _subscribe_param(self, caller: str, uri: str, key: str) -> tuple[str, Any]:
        if self._parameters.subscription_count >= MAX_PARAMETER_SUBSCRIPTIONS:
            raise StatusError(0, f"over {MAX_PARAMETER_SUBSCRIPTIONS} parameter subscriptions")
        return f"subscribed to {key}", self._parameters.subscribe(_key(key, caller), caller, _uri(uri))

    def _unsubscribe_param(self, caller: str, uri: str, key: str) -> tuple[str, Any]:
        return f"unsubscribed from {key}", int(self._parameters.unsubscribe(_key(key, caller), uri))

    def _join(self, caller: str, name: str, uri: str) -> str:
        """Register the caller by its slave URI; return the global form of the name."""
        resolved = resolve(name, validate_global(caller))
        replaced = self._graph.join(caller, _uri(uri))
        if replaced is not None:
            self._services = {name: entry for name, entry in self._services.items() if entry[0] != caller}
            self._parameters.forget(replaced.uri)
            self._notifier.notify(replaced.uri, "shutdown", "", f"[{caller}] new node registered with same name")
            self._tell_subscribers(replaced.published)
        return resolved

    def _tell_subscribers(self, topics: Iterable[str]) -> None:
        for topic in topics:
            publishers = self._graph.publishers.uris(topic)
            for uri in self._graph.subscribers.uris(topic):
                self._notifier.notify(uri, "publisherUpdate", topic, topic, publishers)

    def _tell_parameters(self, updates: list[ParameterUpdate]) -> None:
        for update in updates:
            self._notifier.notify(update.caller_api, "paramUpdate", update.key, update.key, update.value)


def _uri(uri: str) -> str:
    scheme, separator, rest = uri.partition("://")
    if scheme not in ("http", "https", "rosrpc") or not separator or not rest:
        raise StatusError(ERROR, f"not the URI of a node: {uri[:80]!r}")
    return uri


def _type(name: str) -> str:
    return name if name == "*" else validate_type(name)


def _key(key: str, caller: str) -> str:
    if not key:
        raise StatusError(ERROR, "a parameter's key must not be empty")
    if not key.strip("/"):
        return "/"
    return resolve(key, caller)
