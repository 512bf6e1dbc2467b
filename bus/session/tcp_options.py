"""TCP options for which Zenoh (1.10) has no setting.

Links close in time although the other end no longer reads: Zenoh gives its connections ten seconds to get rid of what
is unsent, and waits for that when it closes a session. Small messages do not wait behind images in the system where a
link is slow: messages that are not on their way yet stay with Zenoh, which sends by priority.
"""

import logging
import os
import socket
import struct
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Final

LINGER_S: Final = 1
UNSENT_BYTES: Final = 64 << 10
"""Most unsent data that the system buffers for a link: as much as Zenoh writes at once."""

_FILES: Final = Path("/proc/self/fd")
_LINGER: Final = struct.pack("ii", 1, LINGER_S)

_log: Final = logging.getLogger(__name__)


class TcpTuning:
    """Sets the options of new links, several at once, since each pass looks at every open file of the process.

    do: has something done a little later, on the thread that adds links.
    """

    def __init__(self, do: Callable[[Callable[[], None]], None]) -> None:
        self._do = do
        self._new: set[str] = set()

    def add(self, locator: str) -> None:
        """Queue the links whose local end is at a locator."""
        if not self._new:
            self._do(self._tune)
        self._new.add(locator)

    def _tune(self) -> None:
        locators, self._new = self._new, set()
        try:
            tune(locators)
        except OSError as error:  # the system does not list connections: links work without the options
            _log.debug("TCP options of links at %s are not set: %s", ", ".join(locators), error)


def tune(locators: Collection[str]) -> None:
    """Bound the linger time and the unsent data of connections whose local end is at a locator.

    A locator is like tcp/127.0.0.1:7447 or tcp/[::1]:7447?rel=0.
    """
    addresses = {each.partition("/")[2].partition("?")[0].partition("#")[0] for each in locators}
    for entry in _FILES.iterdir():
        if _is_socket(entry):
            _tune(int(entry.name), addresses)


def _is_socket(entry: Path) -> bool:
    try:
        return entry.readlink().name.startswith("socket:")
    except FileNotFoundError:
        return False


def _tune(descriptor: int, addresses: Collection[str]) -> None:
    try:
        duplicate = os.dup(descriptor)
    except OSError:  # closed meanwhile
        return
    try:
        connection = socket.socket(fileno=duplicate)
    except OSError:  # closed meanwhile and reused for something else
        os.close(duplicate)
        return
    with connection:
        if connection.type == socket.SOCK_STREAM and _text(connection.getsockname()) in addresses:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _LINGER)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)


def _text(socket_address: object) -> str:
    match socket_address:
        case (str(host), int(port)):
            return f"{host}:{port}"
        case (str(host), int(port), _, _):
            return f"[{host}]:{port}"
        case _:
            return ""
