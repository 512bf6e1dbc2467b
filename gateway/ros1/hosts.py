"""Where to listen, given the name that others are told."""

from __future__ import annotations

import ipaddress
import socket
from typing import Final

BACKLOG: Final = 1024
"""Connections that may wait to be accepted; whoever finds this full waits a second before it tries again."""


def listen_address(host: str) -> str:
    """Return the loopback for a loopback host, else every interface: a robot's public name may not be a local one."""
    if host == "localhost":
        return "127.0.0.1"
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return "0.0.0.0"  # noqa: S104 - what ROS_HOSTNAME asks for
    if address.is_loopback:
        return host
    return "::" if address.version == 6 else "0.0.0.0"  # noqa: S104 - what ROS_IP asks for


def is_loopback(host: str) -> bool:
    """Whether a host's name or address is each machine's own for itself, as far as it tells."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def listen(host: str, port: int = 0) -> socket.socket:
    """Return a listening, non-blocking socket; port 0 takes a free one.

    Raises:
        OSError: the port is taken.

    """
    address = listen_address(host)
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    listener = socket.create_server((address, port), family=family, backlog=BACKLOG)
    listener.settimeout(0)
    return listener


def uri_host(host: str) -> str:
    """Return the host as it is written inside a URI."""
    return f"[{host}]" if ":" in host else host
