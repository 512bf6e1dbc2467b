"""The slave API, which the master, publishers, subscribers and tools call on a node, and who may call it."""

from __future__ import annotations

import ipaddress
import logging
import os
from typing import TYPE_CHECKING, Any, Final, Protocol
from urllib.parse import urlsplit

from gateway.ros1.errors import ERROR, FAILURE, StatusError
from gateway.ros1.listening import is_local
from gateway.ros1.xmlrpc.methods import Methods

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gateway.ros1.resolver import Resolver

log = logging.getLogger(__name__)

MASTER_ONLY: Final = frozenset({"publisherUpdate", "paramUpdate", "shutdown"})
MAX_NAMED: Final = 64
"""Number of addresses whose refused calls are logged."""

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


class MasterCalls:
    """Refuses the master's calls from other machines than the master's.

    The master's addresses are all that its host had when it was last looked up, which is with each call to it. If one
    of them is this machine's, so may each of this machine's be: `rosnode kill` beside the master calls from any.

    refused: how many calls were refused.
    """

    def __init__(self, master_uri: str, resolver: Resolver) -> None:
        self.refused = 0
        self._host = urlsplit(master_uri).hostname or ""
        self._uri = master_uri
        self._resolver = resolver
        self._named: set[str] = set()
        resolver.keep(self._host)

    def check(self, peer: str, method: str) -> None:
        """Let a call pass, or refuse it.

        Raises:
            StatusError: the method is the master's, and the peer's address is not.

        """
        if method not in MASTER_ONLY or self._is_master(peer):
            return
        self.refused += 1
        if peer not in self._named and len(self._named) < MAX_NAMED:
            self._named.add(peer)
            known = ", ".join(sorted(self._resolver.kept(self._host))) or "not known yet"
            log.warning(
                "%s called %s, which is for the ROS master at %s (%s): refused; further calls from there are only "
                "counted. Call from the master's machine, or give the master a host name with all its addresses",
                *(peer, method, self._uri, known),
            )
        raise StatusError(ERROR, f"{method} is taken from the ROS master's addresses only, and {peer} is none of them")

    def _is_master(self, peer: str) -> bool:
        known = {_plain(address) for address in self._resolver.kept(self._host)}
        peer = _plain(peer)
        return peer in known or (is_local(peer) and any(is_local(address) for address in known))


def _plain(address: str) -> str:
    """Return an address without its zone, an IPv4 one without the form that IPv6 has for it."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    mapped = parsed.ipv4_mapped if isinstance(parsed, ipaddress.IPv6Address) else None
    return str(mapped or parsed)
