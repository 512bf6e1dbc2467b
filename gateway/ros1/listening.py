"""Listening sockets: which address to listen on, and accepting connections without losing one."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import socket
from contextlib import closing
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable


log = logging.getLogger(__name__)
_RETRY_S: Final = 0.5


class Acceptor:
    """Passes on each connection, non-blocking, with its peer's address, until it is closed."""

    def __init__(self, listener: socket.socket, on_connection: Callable[[socket.socket, str], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._on_connection = on_connection
        self._retry: asyncio.TimerHandle | None = None
        self._begin()

    def close(self) -> None:
        """Stop accepting and close the listener; may be called repeatedly."""
        if self._retry is not None:
            self._retry.cancel()
        if self._listener.fileno() >= 0:
            self._loop.remove_reader(self._listener)
            self._listener.close()

    def _begin(self) -> None:
        self._loop.add_reader(self._listener, self._accept)

    def _accept(self) -> None:
        try:
            connection, peer = self._listener.accept()
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):  # the peer has left
            return
        except OSError as error:
            log.warning("no connection can be accepted: %s", error)
            self._loop.remove_reader(self._listener)
            self._retry = self._loop.call_later(_RETRY_S, self._begin)
            return
        connection.settimeout(0)
        self._on_connection(connection, peer[0])


BACKLOG: Final = 1024
"""Connections that may wait to be accepted; when full, a peer retries after a second."""


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
    """Return whether a host name or address is the loopback, as far as it tells."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def is_local(address: str) -> bool:
    """Return whether a process on this machine can listen at the address."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        with closing(socket.socket(family, socket.SOCK_DGRAM)) as probe:
            probe.bind((address, 0))
    except OSError:
        return False
    return True


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
    """Return the host as written in a URI, an IPv6 address in brackets."""
    return f"[{host}]" if ":" in host else host
