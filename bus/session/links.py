"""The links of a session: which configured endpoints are connected, and why the others are not.

Zenoh (1.10) does not report why a connection failed.

"""

import queue
import re
import socket
import threading
from collections.abc import Sequence
from ipaddress import IPv6Address, ip_address
from typing import Final

from bus.settings import WITH_TLS, BusSettings, port_of

_HOST: Final = re.compile(r"[a-z]+/\[?([^\]?#]*)\]?:\d+")


class Links:
    """The links of a session, each as (local end, remote end); true while one to a configured endpoint is up."""

    def __init__(self, settings: BusSettings) -> None:
        self._settings = settings
        self._there: set[tuple[str, str]] = set()
        self._every: set[tuple[str, str]] = set()

    @property
    def count(self) -> int:
        """The number of links, incoming ones included."""
        return len(self._every)

    def __bool__(self) -> bool:
        return bool(self._there)

    def clear(self) -> None:
        self._there.clear()
        self._every.clear()

    def add(self, own: str, other: str) -> bool:
        """Add a link; return whether it leads to a configured endpoint."""
        self._every.add((own, other))
        sought = self._is_sought(other)
        if sought:
            self._there.add((own, other))
        return sought

    def remove(self, own: str, other: str) -> bool:
        """Remove a link; return whether it led to a configured endpoint."""
        self._every.discard((own, other))
        was_there = (own, other) in self._there
        self._there.discard((own, other))
        return was_there

    def missing(self) -> list[str]:
        """Return the endpoints that want a link, as far as addresses and ports tell: hosts may be names.

        A client has one link, to any of them.
        """
        if self._settings.mode == "client" and self._there:
            return []
        others = [other for _, other in self._there]
        return [endpoint for endpoint in self._settings.connect if not any(fits(endpoint, other) for other in others)]

    def _is_sought(self, other: str) -> bool:
        """Whether a link leads to a configured endpoint and is not an incoming one, as far as ports tell.

        When scouting without `connect`, any link counts.
        """
        settings = self._settings
        if settings.has_one_link or (settings.scouting and not settings.connect):
            return True
        return port_of(other) in {port_of(endpoint) for endpoint in settings.connect}


def host_of(endpoint: str) -> str:
    """Return the host of an endpoint or of a link's end; an IPv6 address without brackets."""
    match = _HOST.match(endpoint)
    return match[1] if match is not None else ""


def is_name(host: str) -> bool:
    """Whether a host is a name rather than an address."""
    try:
        ip_address(host)
    except ValueError:
        return True
    return False


def is_unspecified(host: str) -> bool:
    """Whether a host stands for every address of a machine, as 0.0.0.0 and [::] do, the former also within IPv6."""
    if is_name(host):
        return False
    address = ip_address(host)
    mapped = address.ipv4_mapped if isinstance(address, IPv6Address) else None
    return (mapped or address).is_unspecified


def is_loopback(endpoint: str) -> bool:
    """Whether an endpoint is reachable from this machine only."""
    host = host_of(endpoint)
    if host == "localhost" or endpoint.endswith("#iface=lo"):
        return True
    return not is_name(host) and ip_address(host).is_loopback


def fits(endpoint: str, other: str) -> bool:
    """Return whether a link's other end may be an endpoint; names are taken to fit each other."""
    if port_of(endpoint) != port_of(other):
        return False
    asked, linked = host_of(endpoint), host_of(other)
    if is_name(asked) or is_name(linked):
        return True
    return ip_address(asked) == ip_address(linked) or is_unspecified(asked)


RESOLVING_S: Final = 1.0
"""Longest wait for a name server."""


def why_unreached(endpoints: Sequence[str]) -> str:
    """Return in words why none of these endpoints may have a link. Takes up to RESOLVING_S for each name."""
    said = {endpoint: _why_unresolved(host_of(endpoint)) for endpoint in endpoints}
    resolved = [endpoint for endpoint, unresolved in said.items() if not unresolved]
    reasons = list(dict.fromkeys(unresolved for unresolved in said.values() if unresolved))
    if any(endpoint.startswith(WITH_TLS) for endpoint in resolved):
        reasons.append("nothing answers there, or the certificates do not fit")
    elif resolved or not endpoints:
        reasons.append("no Zenoh router answers there")
    return "; ".join(reasons)


def _why_unresolved(host: str) -> str:
    """Return why a host's name has no address, or nothing if it has one.

    The system's resolver cannot be cancelled: it gets a thread of its own, which nothing waits for.
    """
    if not is_name(host):
        return ""
    said: queue.SimpleQueue[str] = queue.SimpleQueue()

    def look_up() -> None:
        try:
            socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
        except (OSError, UnicodeError) as error:
            said.put(f"{host} does not resolve: {getattr(error, 'strerror', None) or error}")
        else:
            said.put("")

    threading.Thread(target=look_up, name=f"resolve {host}", daemon=True).start()
    try:
        return said.get(timeout=RESOLVING_S)
    except queue.Empty:
        return f"{host} does not resolve: no name server answered within {RESOLVING_S:g} s"
