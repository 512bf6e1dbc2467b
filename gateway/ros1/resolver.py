"""Resolves host names. An unknown one can take half a minute, in which nothing else may wait for it."""

from __future__ import annotations

import asyncio
import ipaddress
import socket
from contextlib import suppress
from threading import Thread
from typing import TYPE_CHECKING, Final, TypeVar

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

T = TypeVar("T")

MAX_LOOKUPS: Final = 64
LOOKUP_TIMEOUT_S: Final = 1.5
"""How long an address may keep silent before the next one has its turn: TCP asks again after a second, and whoever
connects gives up after five. A machine in several networks has addresses that cannot be reached from here."""


class Resolver:
    """Resolves each name in a thread of its own, once for all callers.

    asyncio's own lookups share a few threads, which a handful of publishers on a machine that nobody knows by name
    keeps busy: then no other name is found any more.
    """

    def __init__(self) -> None:
        self._under_way: dict[str, asyncio.Future[list[str]]] = {}
        self._kept: dict[str, frozenset[str]] = {}

    def keep(self, host: str) -> None:
        """Keep a host's addresses from now on."""
        self._kept[host] = frozenset([host]) if _is_address(host) else frozenset()

    def kept(self, host: str) -> frozenset[str]:
        """Return the addresses that a kept host had when it was last found; none if it was not yet."""
        return self._kept[host]

    async def connect(self, host: str, connect: Callable[[str], Awaitable[T]]) -> T:
        """Return the result of `connect` for the first address of a host that it succeeds with.

        Raises:
            OSError, UnicodeError: the host is not known, or none of its addresses answers.

        """
        failed: list[OSError] = []
        addresses = await self.addresses(host)
        for address in addresses:
            deadline = asyncio.timeout(None if address is addresses[-1] else LOOKUP_TIMEOUT_S)
            try:
                async with deadline:
                    return await connect(address)
            except OSError as error:
                failed.append(OSError(f"no answer from {address}") if deadline.expired() else error)
        raise next((each for each in failed if not isinstance(each, ConnectionRefusedError)), failed[0])

    async def addresses(self, host: str) -> list[str]:
        """Return a host's addresses; an address resolves to itself.

        Raises:
            OSError, UnicodeError: the host is not known.

        """
        if _is_address(host):
            return [host]
        if host not in self._under_way:
            if len(self._under_way) >= MAX_LOOKUPS:
                raise OSError(f"{host}: {MAX_LOOKUPS} other names are being looked up")
            self._begin(host)
        return await asyncio.shield(self._under_way[host])

    def _begin(self, host: str) -> None:
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[list[str]] = loop.create_future()
        answer.add_done_callback(lambda _: self._end(host))
        self._under_way[host] = answer
        # A daemon thread, so that a pending lookup does not keep the process from ending.
        Thread(target=_look_up, args=(host, loop, answer), name=f"look up {host}", daemon=True).start()

    def _end(self, host: str) -> None:
        """Forget a lookup and mark its failure as seen: its callers may have given up before."""
        answer = self._under_way.pop(host)
        if answer.exception() is None and host in self._kept:
            self._kept[host] = frozenset(answer.result())


def _is_address(host: str) -> bool:
    with suppress(ValueError):
        ipaddress.ip_address(host)
        return True
    return False


def _look_up(host: str, loop: asyncio.AbstractEventLoop, answer: asyncio.Future[list[str]]) -> None:
    with suppress(RuntimeError):  # the loop has been closed
        try:
            rows = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
        except (OSError, UnicodeError) as error:
            loop.call_soon_threadsafe(answer.set_exception, error)
        else:
            loop.call_soon_threadsafe(answer.set_result, list(dict.fromkeys(str(row[4][0]) for row in rows)))
