"""What Zenoh (1.10) has no setting for on its own TCP connections.

Links close in time although the other end no longer reads: Zenoh gives its connections ten seconds to get rid of what
is unsent, and waits for that when it closes a session. Small messages do not wait behind images in the system where a
link is slow: what is not on its way yet stays with Zenoh, which sends by priority.
"""

import os
import socket
import struct
from pathlib import Path
from typing import Final

LINGER_S: Final = 1
UNSENT_BYTES: Final = 64 << 10
"""What the system takes ahead of a link, beside what is on its way: as much as Zenoh writes at once."""

_FILES: Final = Path("/proc/self/fd")
_LINGER: Final = struct.pack("ii", 1, LINGER_S)


def tune(locator: str) -> None:
    """Bound how long this process's connections whose own end is at a locator linger, and what they hold unsent.

    A locator is like tcp/127.0.0.1:7447 or tcp/[::1]:7447?rel=0.
    """
    address = locator.partition("/")[2].partition("?")[0].partition("#")[0]
    for entry in _FILES.iterdir():
        if _is_socket(entry):
            _tune(int(entry.name), address)


def _is_socket(entry: Path) -> bool:
    try:
        return entry.readlink().name.startswith("socket:")
    except FileNotFoundError:
        return False


def _tune(descriptor: int, address: str) -> None:
    try:
        duplicate = os.dup(descriptor)
    except OSError:  # closed meanwhile
        return
    try:
        connection = socket.socket(fileno=duplicate)
    except OSError:  # closed meanwhile, and opened again as something else
        os.close(duplicate)
        return
    with connection:
        if connection.type == socket.SOCK_STREAM and _text(connection.getsockname()) == address:
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
