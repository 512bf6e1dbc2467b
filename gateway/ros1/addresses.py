"""Addresses as a person writes them: a master's, and the one under which other nodes reach this machine."""

from __future__ import annotations

import re
from typing import Any

from gateway.ros1.errors import InvalidNameError

_HOST = r"(?:[A-Za-z0-9](?:[A-Za-z0-9_.\-]{0,252})|\[?[0-9A-Fa-f:]{2,45}\]?)"
_SERVICE = re.compile(rf"rosrpc://(?P<host>{_HOST}):(?P<port>\d{{1,5}})/?")
_MASTER = re.compile(rf"http://{_HOST}:(?P<port>\d{{1,5}})/?")


def validate_master_uri(text: str) -> str:
    """Return a master's address without a slash at its end.

    Raises:
        InvalidNameError: it does not look like `http://robot:11311`.

    """
    match = _MASTER.fullmatch(text)
    if match is None or not 0 < int(match["port"]) < 65536:
        raise InvalidNameError(f"{text!r} is no ROS master's address, which looks like http://robot:11311")
    return text.rstrip("/")


def parse_rosrpc(uri: str) -> tuple[str, int]:
    """Return host and port of a service's URI, as masters give it.

    Raises:
        InvalidNameError: it does not look like `rosrpc://robot:40001`.

    """
    match = _SERVICE.fullmatch(uri)
    if match is None or not 0 < int(match["port"]) < 65536:
        raise InvalidNameError(f"{uri[:80]!r} is no service's address, which looks like rosrpc://robot:40001")
    return match["host"].strip("[]"), int(match["port"])


def parse_offer(answer: Any) -> tuple[str, int]:
    """Return the host and port at which a publisher speaks TCPROS, given what it answers to requestTopic.

    Raises:
        InvalidNameError: it offers nothing of the kind.

    """
    match answer:
        case ["TCPROS", str(host), int(port)] if host and 0 < port < 65536:
            return host, port
    raise InvalidNameError(f"it offers {str(answer)[:80]!r} instead of TCPROS")


def validate_host(text: str) -> str:
    """Return a host's name or address, without the brackets in which a URI has one of IPv6.

    Raises:
        InvalidNameError: it is neither.

    """
    if not re.fullmatch(_HOST, text):
        raise InvalidNameError(f"{text!r} is neither a host's name nor an address")
    return text.strip("[]")
