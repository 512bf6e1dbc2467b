"""Garbage collections that stop everything for milliseconds alone: a full one of 5,000 robots takes 0.2 s."""

import asyncio
import gc
from collections.abc import Callable
from typing import Final

PERIOD_S: Final = 10.0
LEAST: Final = 100
GROWTH: Final = 1.125
"""By how much there is more when what is new is left out too: until then collections look at it."""

YOUNG: Final = 1_500
"""How many new objects are looked at, at once: a millisecond or two."""

MIDDLE: Final = 1
"""How many times that until those that stayed are looked at with them."""

NEVER: Final = 1_000_000_000
FULL_AFTER: Final = 50
"""After how many of those what is old is looked at: a tenth of a second, after more than a hundred pages."""


async def keep_collections_short(size: Callable[[], int], *, period_s: float = PERIOD_S) -> None:
    """Leave out of collections what is there for good, for ever. size: how much there is, in any unit.

    What is new is left out once in a while as there comes more. What was left out is looked at again after each
    doubling alone, so that little garbage is left out too.
    """
    usual = gc.get_threshold()
    gc.set_threshold(YOUNG, MIDDLE, NEVER)
    looked_at = left_out = 0.0
    try:
        while True:
            await asyncio.sleep(period_s)
            found = max(LEAST, size())
            if found >= 2 * looked_at:
                gc.unfreeze()
                looked_at = found
            elif found < GROWTH * left_out:
                if gc.get_count()[2] >= FULL_AFTER:
                    gc.collect()
                continue
            gc.collect()
            gc.freeze()
            left_out = found
    finally:
        gc.unfreeze()
        gc.set_threshold(*usual)
