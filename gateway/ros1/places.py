"""How many calls may be under way: in all, and to one host, so that one which is switched off delays itself alone."""

from __future__ import annotations

from asyncio import Semaphore
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Final
from weakref import WeakValueDictionary

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

AT_A_HOST: Final = 64
IN_ALL: Final = 256


class Places:
    """Has places for AT_A_HOST calls to each host, and for IN_ALL calls."""

    def __init__(self) -> None:
        self._all = Semaphore(IN_ALL)
        self._at: WeakValueDictionary[str, Semaphore] = WeakValueDictionary()

    @asynccontextmanager
    async def at(self, host: str) -> AsyncIterator[None]:
        """Wait for a place and hold it for as long as the context lasts."""
        at_host = self._at.setdefault(host, Semaphore(AT_A_HOST))  # there for as long as somebody waits or calls
        async with at_host, self._all:
            yield
