"""Full garbage collections that do not grow with the fleet: they stop everything, for 0.2 s with 5,000 cameras."""

import asyncio
import gc
from collections.abc import Callable
from typing import Final

PERIOD_S: Final = 10.0
LEAST: Final = 100
GROWTH: Final = 1.125
"""By how much there is more when what is new is left out too: until then collections look at it."""


async def keep_collections_short(size: Callable[[], int], *, period_s: float = PERIOD_S) -> None:
    """Leave out of collections what is there for good, for ever. size: how much there is, in any unit.

    What is new is left out once in a while as there comes more. What was left out is looked at again after each
    doubling alone, so that little garbage is left out too.
    """
    looked_at = left_out = 0.0
    try:
        while True:
            await asyncio.sleep(period_s)
            found = max(LEAST, size())
            if found >= 2 * looked_at:
                gc.unfreeze()
                looked_at = found
            elif found < GROWTH * left_out:
                continue
            gc.collect()
            gc.freeze()
            left_out = found
    finally:
        gc.unfreeze()
