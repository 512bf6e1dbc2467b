from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable


async def until(condition: Callable[[], object], what: str, limit_s: float = 60.0) -> None:
    """Return when the condition holds; fail the test when it does not within the limit."""
    try:
        async with asyncio.timeout(limit_s):
            while not condition():  # noqa: ASYNC110 - a condition of any kind, in other processes too
                await asyncio.sleep(0.01)
    except TimeoutError:
        pytest.fail(f"waited {limit_s} s in vain until {what}")
