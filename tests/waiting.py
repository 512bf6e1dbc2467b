"""Waiting for what is promised to come, for a while."""

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Final, TypeVar

import pytest

from bus import Subscription
from schemas import codec
from schemas.codec import M

PATIENCE_S: Final = 60

T = TypeVar("T")


async def next_of(source: AsyncIterator[T]) -> T:
    async with asyncio.timeout(PATIENCE_S):
        return await anext(source)


async def receive(subscription: Subscription, schema: type[M]) -> M:
    sample = await next_of(subscription)
    return codec.decode(schema, sample.payload, sample.encoding)


async def until(condition: Callable[[], object], what: str = "it holds") -> None:
    """Return when the condition holds; fail the test when it does not within PATIENCE_S."""
    try:
        async with asyncio.timeout(PATIENCE_S):
            while not condition():  # noqa: ASYNC110 - a condition of any kind, in other processes too
                await asyncio.sleep(0.005)
    except TimeoutError:
        pytest.fail(f"waited {PATIENCE_S} s in vain until {what}")
