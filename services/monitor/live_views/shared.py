"""Shared work: it begins with its first user and ends with the last."""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Hashable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
S = TypeVar("S")


class CrowdedError(Exception):
    """The limit of different things in use is reached."""


@dataclass(slots=True)
class _Holding(Generic[S]):
    state: S
    task: asyncio.Task[None]
    holders: int = 0


class SharedSubscriptions(Generic[K, S]):
    """States that are kept up to date while held, by key. For the event loop's thread only.

    make: makes a key's state. follow: keeps it up to date for ever. most: how many keys are held at once.
    """

    def __init__(
        self, make: Callable[[K], S], follow: Callable[[K, S], Coroutine[None, None, None]], most: int
    ) -> None:
        self._make = make
        self._follow = follow
        self._most = most
        self._holdings: dict[K, _Holding[S]] = {}

    @property
    def keys(self) -> list[K]:
        """The keys that are held now."""
        return list(self._holdings)

    def peek(self, key: K) -> S | None:
        """Return the state of a key that is held."""
        holding = self._holdings.get(key)
        return holding.state if holding else None

    @asynccontextmanager
    async def hold(self, key: K) -> AsyncIterator[S]:
        """Keep the state up to date within the context; the last holder waits for its cleanup.

        Raises:
            CrowdedError: too many other keys are held.
            Exception: the error that ended `follow`; raised in the last holder.
        """
        holding = self._holdings.get(key) or self._begin(key)
        holding.holders += 1
        try:
            yield holding.state
        finally:
            holding.holders -= 1
            if not holding.holders:
                del self._holdings[key]
                holding.task.cancel()
                await asyncio.wait([holding.task])
                if not holding.task.cancelled():
                    holding.task.result()

    def _begin(self, key: K) -> _Holding[S]:
        if len(self._holdings) >= self._most:
            raise CrowdedError(f"{self._most} are already open; close another view first")
        state = self._make(key)
        holding = _Holding(state, asyncio.create_task(self._follow(key, state)))
        self._holdings[key] = holding
        return holding
