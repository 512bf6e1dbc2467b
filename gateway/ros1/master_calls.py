"""The calls of the slave API that only the master makes, and the addresses from which it may make them."""

from __future__ import annotations

import ipaddress
import logging
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

from gateway.ros1.errors import ERROR, StatusError
from gateway.ros1.listening import is_local

if TYPE_CHECKING:
    from gateway.ros1.resolver import Resolver

log = logging.getLogger(__name__)

MASTER_ONLY: Final = frozenset({"publisherUpdate", "paramUpdate", "shutdown"})
MAX_NAMED: Final = 64


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
