"""Sessions for a moment: whether a listener takes links, and to have a router look again at who subscribes."""

import json
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any, Final

import zenoh

from bus.errors import BusError
from bus.session.config import session_config
from bus.session.declaration import close_session, reason_of
from bus.session.links import host_of, is_unspecified
from bus.session.panics import panics_are_errors
from bus.settings import BusSettings, port_of

LOOPBACK: Final = {False: "127.0.0.1", True: "[::1]"}
"""Address of this machine in place of all its addresses: IPv4, IPv6."""


def own_listeners(settings: BusSettings) -> list[str]:
    """Return the endpoints at which this process can connect to itself.

    None of port 0 or of one network interface alone, and none where the bus takes any link for one that it sought.
    """
    if settings.scouting and not settings.connect:
        return []
    return [_from_here(each) for each in settings.listen if port_of(each) != "0" and "#" not in each]


def why_not_taken(settings: BusSettings, endpoint: str, *, own: bool = True) -> str:
    """Open a session over an endpoint and close it; return why not, or nothing. Blocks for up to two seconds.

    own: it is this process's listener, under an address of loopback that its certificate need not name.
    """
    try:
        with _session(settings, endpoint, own=own) as session:
            linked = bool(session.info.links())
    except (zenoh.ZError, BusError) as error:
        return reason_of(error)
    return "" if linked else "the link was closed at once"


def subscribe_briefly(settings: BusSettings, endpoint: str, keys: Collection[str]) -> bool:
    """Subscribe to keys at a router and take it back at once; return whether it answered. Blocks for up to two seconds.

    The router then looks again at who else subscribes to each of them.
    """
    try:
        with _session(settings, endpoint, own=False) as session:
            for key in keys:  # each for a moment: what is published under it goes to this session meanwhile
                session.declare_subscriber(key, _leave).undeclare()
            return bool(session.info.links())
    except (zenoh.ZError, BusError):
        return False


def _leave(_: zenoh.Sample) -> None:
    """Take nothing."""


@contextmanager
def _session(settings: BusSettings, endpoint: str, *, own: bool) -> Iterator[zenoh.Session]:
    with panics_are_errors():
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(_config(settings, endpoint, own=own))))
        try:
            yield session
        finally:
            close_session(session)


def _config(settings: BusSettings, endpoint: str, *, own: bool) -> dict[str, Any]:
    client = {"mode": "client", "connect": [endpoint], "listen": [], "scouting": False, "shared_memory": False}
    config = session_config(settings.model_copy(update=client))
    if own:  # the certificate names the host as others know it, not the loopback address
        config["transport"]["link"]["tls"]["verify_name_on_connect"] = False
    return config


def _from_here(endpoint: str) -> str:
    host = host_of(endpoint)
    if not is_unspecified(host):
        return endpoint
    return f"{endpoint.partition('/')[0]}/{LOOPBACK[':' in host]}:{port_of(endpoint)}"
