"""Detects calls that no longer answer: of a model, or of the thread that measures."""

from asyncio import sleep
from collections.abc import AsyncIterator, Callable
from typing import Final

CHECK_S: Final = 1.0

STALLED: Final = 2
"""Checks after which a worker shows no longer that it serves its cameras, so that other workers take them."""

PROMPT_S: Final = 5.0
"""Time without such a call after which it shows them again."""

HUNG: Final = 60
"""Checks after which an unanswered call counts as hung; calls of a model with new shapes may take seconds."""


async def unanswered(pending: Callable[[], object]) -> AsyncIterator[int]:
    """Yield every CHECK_S for how many checks in a row the same call has not answered.

    Time in which the process is suspended does not count. pending: returns what the next answer is known by, something
    else after each; None while nothing is asked.
    """
    checks, before = 0, None
    while True:
        await sleep(CHECK_S)
        now = pending()
        checks = checks + 1 if now is not None and now == before else 0
        before = now
        yield checks
