"""Why there may be no link to where one is sought: Zenoh (1.10) does not say."""

import queue
import socket
import threading
from collections.abc import Sequence
from typing import Final

from bus.links import host_of, is_name
from bus.settings import WITH_TLS

RESOLVING_S: Final = 1.0
"""How long it is waited for a name server."""


def why_unreached(endpoints: Sequence[str]) -> str:
    """Say in words why nothing may be linked at any of these endpoints. Takes up to RESOLVING_S for each name."""
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
        return f"no name server says within {RESOLVING_S:g} s where {host} is"
