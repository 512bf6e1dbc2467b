"""Addresses in settings: the master's, and the one at which other nodes reach this machine."""

from __future__ import annotations

import ipaddress
import re
from typing import Any

from gateway.ros1.errors import InvalidNameError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.\-]{0,252}")
_IPV6 = re.compile(r"[0-9A-Fa-f:.]+(?:%[A-Za-z0-9_.\-]{1,15})?")  # a zone is an interface's name or number
_URI = re.compile(r"(?P<scheme>[a-z]+)://(?P<host>[^:]+|\[.+\]):(?P<port>[0-9]{1,5})/?")


def validate_master_uri(text: str) -> str:
    """Return a valid master's address, without a trailing slash.

    Raises:
        InvalidNameError: it does not look like `http://robot:11311`.

    """
    if _host_and_port("http", text) is None:
        looks = "http://robot:11311 or http://[fd00::7]:11311"
        raise InvalidNameError(f"{text!r} is not a ROS master's address; use one like {looks}")
    return text.rstrip("/")


def parse_rosrpc(uri: str) -> tuple[str, int]:
    """Return host and port of a service's rosrpc URI.

    Raises:
        InvalidNameError: it does not look like `rosrpc://robot:40001`.

    """
    found = _host_and_port("rosrpc", uri)
    if found is None:
        raise InvalidNameError(f"{uri[:80]!r} is not a service's address; those look like rosrpc://robot:40001")
    return found


def parse_offer(answer: Any) -> tuple[str, int]:
    """Return host and port of a publisher's TCPROS server from its answer to requestTopic.

    Raises:
        InvalidNameError: it offers nothing of the kind.

    """
    match answer:
        case ["TCPROS", str(host), int(port)] if host and 0 < port < 65536:
            return host, port
    raise InvalidNameError(f"it offers {str(answer)[:80]!r} instead of TCPROS")


def validate_host(text: str) -> str:
    """Return a valid host name or address; an IPv6 address without brackets.

    Raises:
        InvalidNameError: it is neither.

    """
    host = _host(text)
    if host is None:
        raise InvalidNameError(f"{text!r} is neither a host name nor an address")
    return host


def _host_and_port(scheme: str, uri: str) -> tuple[str, int] | None:
    match = _URI.fullmatch(uri)
    if match is None or match["scheme"] != scheme or not 0 < int(match["port"]) < 65536:
        return None
    host = _host(match["host"])
    return None if host is None else (host, int(match["port"]))


def _host(text: str) -> str | None:
    """Return a host without the brackets of IPv6, or None if it is not valid."""
    if _NAME.fullmatch(text):
        return text
    address = text[1:-1] if text[:1] + text[-1:] == "[]" else text
    return address if _is_ipv6(address) else None


def _is_ipv6(text: str) -> bool:
    try:
        return _IPV6.fullmatch(text) is not None and ipaddress.ip_address(text).version == 6
    except ValueError:
        return False
