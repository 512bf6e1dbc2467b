"""Long work on the event loop, done bit by bit."""

import asyncio
from collections.abc import AsyncIterable, AsyncIterator, Iterable
from typing import Final, TypeVar

AT_ONCE: Final = 100
"""Items until other things get their turn."""

PAUSE_S: Final = 0.001
"""A moment in which the event loop does nothing: other threads, such as the bus's, get the interpreter at once then."""

T = TypeVar("T")


async def pause() -> None:
    """Let everybody else have their turn."""
    await asyncio.sleep(PAUSE_S)


async def in_turns(items: Iterable[T], at_once: int = AT_ONCE) -> AsyncIterator[T]:
    """Yield items; whatever else waits, on the event loop or on other threads, gets its turn after each `at_once`."""
    for number, item in enumerate(items, 1):
        yield item
        if number % at_once == 0:
            await pause()


async def arrivals_in_turns(arrivals: AsyncIterable[T]) -> AsyncIterator[T]:
    """Yield what arrives; like `in_turns` where much waits already, since then nothing is waited for."""
    number = 0
    async for arrival in arrivals:
        yield arrival
        number += 1
        if number % AT_ONCE == 0:
            await asyncio.sleep(0)
