"""Client of the master API. Every method raises CallError or XmlRpcError."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from gateway.ros1.errors import StatusError, XmlRpcError
from gateway.ros1.sim_clock import PARAMETER

if TYPE_CHECKING:
    from collections.abc import Mapping

    from gateway.ros1.xmlrpc.client import XmlRpcClient

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class SystemState:
    """Node names by topic or service name."""

    publishers: Mapping[str, tuple[str, ...]]
    subscribers: Mapping[str, tuple[str, ...]]
    services: Mapping[str, tuple[str, ...]]

    def nodes(self) -> set[str]:
        """Return the names of all registered nodes."""
        books = (self.publishers, self.subscribers, self.services)
        return {node for book in books for nodes in book.values() for node in nodes}


class MasterClient:
    """Calls one master on behalf of one node. caller_id: the node's name now."""

    def __init__(self, client: XmlRpcClient, *, uri: str, caller_id: str) -> None:
        self.uri = uri
        self.resolver = client.resolver
        self._client = client
        self.caller_id = caller_id

    async def register_subscriber(self, topic: str, type_name: str, caller_api: str) -> tuple[str, ...]:
        """Return the slave URIs of the topic's publishers."""
        return _strings(await self.call("registerSubscriber", topic, type_name, caller_api))

    async def unregister_subscriber(self, topic: str, caller_api: str) -> bool:
        """Return whether the registration existed."""
        return bool(_is(int, await self.call("unregisterSubscriber", topic, caller_api)))

    async def register_publisher(self, topic: str, type_name: str, caller_api: str) -> tuple[str, ...]:
        """Return the slave URIs of the topic's subscribers."""
        return _strings(await self.call("registerPublisher", topic, type_name, caller_api))

    async def unregister_publisher(self, topic: str, caller_api: str) -> bool:
        """Return whether the registration existed."""
        return bool(_is(int, await self.call("unregisterPublisher", topic, caller_api)))

    async def get_system_state(self) -> SystemState:
        parts = _is(list, await self.call("getSystemState"))
        if len(parts) != 3:
            raise XmlRpcError(f"a system state of {len(parts)} parts")
        return SystemState(*(_by_name(part) for part in parts))

    async def get_topic_types(self) -> dict[str, str]:
        """Return message type names by topic, of all topics ever registered; `*` if unknown."""
        pairs = (_pair(item) for item in _is(list, await self.call("getTopicTypes")))
        return {_is(str, name): _is(str, kind) for name, kind in pairs}

    async def lookup_node(self, name: str) -> str:
        """Return the node's slave URI; StatusError when unknown."""
        return _is(str, await self.call("lookupNode", name))

    async def lookup_service(self, name: str) -> str:
        """Return the service's URI, `rosrpc://host:port`; StatusError when unknown."""
        return _is(str, await self.call("lookupService", name))

    async def get_pid(self) -> int:
        return _is(int, await self.call("getPid"))

    async def uses_sim_time(self) -> bool:
        """Return whether `/use_sim_time` is set: as in rospy, any true value counts."""
        try:
            return bool(await self.call("getParam", PARAMETER))
        except StatusError:
            return False

    async def call(self, method: str, *params: Any) -> Any:
        """Call any method of the master API and return its value."""
        return await self._client.call(self.uri, method, self.caller_id, *params)


def _is(kind: type[T], value: Any) -> T:
    if not isinstance(value, kind):
        raise XmlRpcError(f"{kind.__name__} expected, not {str(value)[:80]!r}")
    return value


def _strings(value: Any) -> tuple[str, ...]:
    return tuple(_is(str, item) for item in _is(list, value))


def _pair(value: Any) -> tuple[Any, Any]:
    match value:
        case [first, second]:
            return first, second
        case _:
            raise XmlRpcError(f"pair expected, not {str(value)[:80]!r}")


def _by_name(value: Any) -> dict[str, tuple[str, ...]]:
    pairs = (_pair(item) for item in _is(list, value))
    return {_is(str, name): _strings(nodes) for name, nodes in pairs}
