"""Detects a model that no longer answers."""

from asyncio import sleep
from collections.abc import Callable
from typing import Final, NoReturn

from services.detector.model import ModelError

WATCH_S: Final = 1.0
HUNG: Final = 60
"""Checks after which an unanswered model counts as hung; calls with new shapes may take seconds."""


async def watch(name: Callable[[], str], pending: Callable[[], object]) -> NoReturn:
    """Watch a model until cancelled; time in which the process is suspended does not count.

    name: returns the model's. pending: returns what its next answer is known by, something else after each; None while
    it is asked nothing.

    Raises:
        ModelError: it does not answer any more.
    """
    silent, before = 0, None
    while True:
        await sleep(WATCH_S)
        now = pending()
        silent = silent + 1 if now is not None and now == before else 0
        before = now
        if silent >= HUNG:
            raise ModelError(f"{name()} has not answered for {HUNG * WATCH_S:g} s")
