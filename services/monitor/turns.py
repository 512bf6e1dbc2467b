"""Long work on the event loop, done bit by bit."""

import asyncio
import time
from collections.abc import AsyncIterable, AsyncIterator, Iterable
from typing import Final, TypeVar

AT_ONCE: Final = 100
"""Arrivals until other things get their turn."""

TURN_S: Final = 0.003
"""How long something may go on until everybody else gets their turn: questions wait for several of them."""

PAUSE_S: Final = 0.001
"""A moment in which the event loop does nothing: other threads, such as the bus's, get the interpreter at once then."""

T = TypeVar("T")


async def pause() -> None:
    """Let everybody else have their turn."""
    await asyncio.sleep(PAUSE_S)


async def in_turns(items: Iterable[T]) -> AsyncIterator[T]:
    """Yield items; whatever else waits, on the event loop or on other threads, gets its turn after each `TURN_S`."""
    began_s = time.perf_counter()
    for item in items:
        yield item
        if time.perf_counter() - began_s > TURN_S:
            await pause()
            began_s = time.perf_counter()


async def arrivals_in_turns(arrivals: AsyncIterable[T]) -> AsyncIterator[T]:
    """Yield what arrives; where much waits already, others get their turn: nothing is waited for then."""
    number = 0
    async for arrival in arrivals:
        yield arrival
        number += 1
        if number % AT_ONCE == 0:
            await asyncio.sleep(0)
