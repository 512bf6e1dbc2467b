"""The iterations of a program over what a fleet gives: none outlives it."""

import asyncio
from collections.abc import AsyncGenerator, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final, TypeVar
from weakref import WeakSet

PATIENCE_S: Final = 2.0
"""How long it is waited for iterations that others are ending."""

T = TypeVar("T")


class Iterations:
    """Those that have begun and not ended. One that a `break` leaves behind is ended by a task of the event loop's."""

    def __init__(self) -> None:
        self._generators: WeakSet[AsyncGenerator[Any, None]] = WeakSet()
        self._unended: set[asyncio.Future[None]] = set()

    def add(self, generator: AsyncGenerator[T, None]) -> AsyncGenerator[T, None]:
        """Take note of an iteration, and return it."""
        self._generators.add(generator)
        return generator

    @contextmanager
    def lasting(self) -> Iterator[None]:
        """Say from within an iteration that it has begun, until it ends."""
        ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._unended.add(ended)
        try:
            yield
        finally:
            self._unended.discard(ended)
            ended.set_result(None)

    async def end(self) -> None:
        """End those that wait for the program to go on."""
        for generator in list(self._generators):
            with suppress(RuntimeError):  # another task waits in it, or ends it
                await generator.aclose()

    async def ended(self) -> None:
        """Wait until all have ended, once nothing more comes."""
        if self._unended:
            await asyncio.wait(self._unended, timeout=PATIENCE_S)
