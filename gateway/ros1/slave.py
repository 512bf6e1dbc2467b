"""The slave API, which the master, publishers, subscribers and tools call on a node."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Protocol

from gateway.ros1.errors import ERROR, FAILURE, StatusError
from gateway.ros1.xmlrpc.methods import Methods

if TYPE_CHECKING:
    from collections.abc import Sequence

_MAX_INT = 2**31 - 1


class SlaveState(Protocol):
    """The node behind the API; no method may block."""

    @property
    def master_uri(self) -> str: ...

    @property
    def tcpros_address(self) -> tuple[str, int]: ...

    def publications(self) -> dict[str, str]:
        """Return message type names by topic."""

    def subscriptions(self) -> dict[str, str]:
        """Return message type names by topic."""

    def publishers_updated(self, topic: str, uris: Sequence[str]) -> None: ...

    def bus_stats(self) -> list[Any]: ...

    def bus_info(self) -> list[Any]: ...

    def shutdown(self, reason: str) -> None: ...


class SlaveApi:
    """Answers the slave API's calls from a node's state."""

    def __init__(self, state: SlaveState) -> None:
        self._state = state
        self._methods = Methods(
            {
                "requestTopic": self._request_topic,
                "publisherUpdate": self._publisher_update,
                "paramUpdate": self._param_update,
                "getBusStats": lambda _: ("bus stats", _fitting(state.bus_stats())),
                "getBusInfo": lambda _: ("bus info", state.bus_info()),
                "getPid": lambda _: ("", os.getpid()),
                "getSubscriptions": lambda _: ("subscriptions", [list(item) for item in state.subscriptions().items()]),
                "getPublications": lambda _: ("publications", [list(item) for item in state.publications().items()]),
                "getMasterUri": lambda _: ("", state.master_uri),
                "shutdown": self._shutdown,
            }
        )

    def call(self, method: str, params: tuple[Any, ...]) -> tuple[str, Any]:
        """Answer one call; raises StatusError or UnknownMethodError as the server expects."""
        return self._methods.call(method, params)

    def _request_topic(self, _caller: str, topic: str, protocols: list[Any]) -> tuple[str, Any]:
        if topic not in self._state.publications():
            raise StatusError(ERROR, f"not a publisher of {topic}", [])
        if not any(isinstance(protocol, list) and protocol[:1] == ["TCPROS"] for protocol in protocols):
            raise StatusError(FAILURE, "only TCPROS is supported", [])
        host, port = self._state.tcpros_address
        return f"ready on {host}:{port}", ["TCPROS", host, port]

    def _publisher_update(self, _caller: str, topic: str, publishers: list[Any]) -> tuple[str, Any]:
        if not all(isinstance(uri, str) for uri in publishers):
            raise StatusError(ERROR, "publishers must be a list of URIs")
        self._state.publishers_updated(topic, publishers)
        return "", 0

    def _param_update(self, _caller: str, key: str, _value: Any) -> tuple[str, Any]:
        raise StatusError(ERROR, f"not subscribed to {key}")

    def _shutdown(self, _caller: str, reason: Any = "") -> tuple[str, Any]:
        self._state.shutdown(str(reason))
        return "shutdown", 0


def _fitting(value: Any) -> Any:
    """Return the value with integers clamped to XML-RPC's range."""
    if isinstance(value, list):
        return [_fitting(item) for item in value]
    return min(value, _MAX_INT) if isinstance(value, int) else value
