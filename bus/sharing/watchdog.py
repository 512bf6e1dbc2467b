"""Detects calls that no longer answer: of a model, or of the thread that measures."""

from asyncio import sleep
from collections.abc import AsyncIterator, Callable
from typing import Final

CHECK_S: Final = 1.0

STALLED: Final = 2
"""Checks after which a call that does not answer counts as a stall."""

PROMPT: Final = 5
"""Checks without one after which the stall is over."""

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


class StallDetector:
    """Tells whether work stands still: a call takes more than twice as long as any did lately, and STALLED checks."""

    def __init__(self) -> None:
        self._before = 0
        self._usual = 0
        self._prompt = PROMPT

    def look(self, checks: int) -> bool:
        """Return whether work stands still. checks: for how many the same call has not answered, at each check."""
        if checks <= self._before:  # it has answered
            self._usual = max(self._before, self._usual - 1)
        self._before = checks
        self._prompt = 0 if checks >= max(STALLED, 2 * self._usual + 1) else self._prompt + 1
        return self._prompt < PROMPT
