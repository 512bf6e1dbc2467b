"""Long work on the event loop pauses regularly, so that other tasks and threads run."""

import asyncio
import time
from collections.abc import AsyncIterable, AsyncIterator, Iterable
from typing import Final, TypeVar

AT_ONCE: Final = 100
"""Arrivals handled before other tasks get a turn."""

TURN_S: Final = 0.003
"""Seconds of work before other tasks get a turn: requests wait for several turns."""

PAUSE_S: Final = 0.001
"""Seconds for which the loop sleeps, so that other threads, such as the bus's, get the interpreter at once."""

T = TypeVar("T")


async def pause() -> None:
    """Let other tasks and threads run."""
    await asyncio.sleep(PAUSE_S)


async def in_turns(items: Iterable[T]) -> AsyncIterator[T]:
    """Yield items; other tasks and threads run after each `TURN_S`."""
    began_s = time.perf_counter()
    for item in items:
        yield item
        if time.perf_counter() - began_s > TURN_S:
            await pause()
            began_s = time.perf_counter()


async def arrivals_in_turns(arrivals: AsyncIterable[T]) -> AsyncIterator[T]:
    """Yield arrivals; under load other tasks get regular turns, as nothing is awaited then."""
    number = 0
    async for arrival in arrivals:
        yield arrival
        number += 1
        if number % AT_ONCE == 0:
            await asyncio.sleep(0)
