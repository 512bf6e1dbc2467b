"""Tests connections to hosts, each step with a deadline."""

import asyncio
from contextlib import suppress
from typing import Final

from gateway.doctor.evidence import Failure, HostLook, Router, Trouble
from gateway.ros1.listening import is_local, uri_host
from gateway.ros1.resolver import Resolver

MAX_ADDRESSES: Final = 4
_TCP: Final = ("tcp", "tls", "ws")
"""Bus protocols whose listener accepts a plain TCP connection."""


async def resolve(host: str, patience_s: float) -> list[str]:
    """Return a host's addresses; none if it has none or its name server does not answer."""
    with suppress(OSError, UnicodeError):
        async with asyncio.timeout(patience_s):
            return (await Resolver().addresses(host.strip("[]")))[:MAX_ADDRESSES]
    return []


async def reach(host: str, port: int, patience_s: float) -> str | Trouble:
    """Return the host's address that accepts a connection, or the reason why none does."""
    addresses = await resolve(host, patience_s)
    if not addresses:
        return Trouble(Failure.UNRESOLVED, host, port)
    troubles = []
    for address in addresses:
        trouble = await _connect(address, port, patience_s / len(addresses))
        if trouble is None:
            return address
        troubles.append(Trouble(trouble[0], host, port, trouble[1]))
    return troubles[-1]


async def _connect(address: str, port: int, patience_s: float) -> tuple[Failure, str] | None:
    try:
        async with asyncio.timeout(patience_s):
            _, writer = await asyncio.open_connection(address, port)
    except TimeoutError:
        return Failure.SILENT, f"no answer within {patience_s:g} s"
    except ConnectionRefusedError:
        return Failure.DEAD, "connection refused"
    except OSError as error:
        return Failure.OFF, error.strerror or str(error)
    writer.transport.abort()
    with suppress(OSError):
        await writer.wait_closed()
    return None


async def look_at_host(host: str, patience_s: float) -> HostLook:
    """Examine the host that other nodes are told to connect to."""
    addresses = await resolve(host, patience_s)
    return HostLook(host, tuple(addresses), any(is_local(address) for address in addresses))


def can_be_tried(endpoint: str) -> bool:
    """Return whether a connection to an endpoint of the bus can be tested, as with TCP."""
    return endpoint.partition("/")[0] in _TCP


async def look_at_router(endpoint: str, patience_s: float) -> Router:
    """Test whether an endpoint of the bus accepts connections, if its protocol allows."""
    host, _, port = endpoint.partition("/")[2].partition("?")[0].partition("#")[0].rpartition(":")
    if not can_be_tried(endpoint):
        return Router(endpoint)
    found = await reach(host, int(port), patience_s)
    return Router(endpoint, found if isinstance(found, Trouble) else None)


def uri_of(address: str, port: int) -> str:
    return f"http://{uri_host(address)}:{port}/"
