"""Keeps garbage collections short."""

import asyncio
import gc
from collections.abc import Callable
from typing import Final

PERIOD_S: Final = 10.0
LEAST: Final = 100
GROWTH: Final = 1.125
"""Growth of the fleet after which new objects are frozen too; below it collections scan them."""

GC_GEN0_THRESHOLD: Final = 1_500
"""Objects allocated before a generation-0 collection, which takes 1-2 ms."""

GC_GEN1_THRESHOLD: Final = 1
"""Generation-0 collections before generation 1 is collected."""

GC_GEN2_DISABLED: Final = 1_000_000_000
FULL_GC_AFTER: Final = 50
"""Generation-1 collections before a full one, which takes about 0.1 s."""


async def keep_collections_short(size: Callable[[], int], *, period_s: float = PERIOD_S) -> None:
    """Exclude long-lived objects from garbage collections, until cancelled. size: their number, in any unit.

    New objects are frozen now and then as their number grows; frozen ones are examined again only when it has doubled.
    """
    usual = gc.get_threshold()
    gc.set_threshold(GC_GEN0_THRESHOLD, GC_GEN1_THRESHOLD, GC_GEN2_DISABLED)
    looked_at = left_out = 0.0
    try:
        while True:
            await asyncio.sleep(period_s)
            found = max(LEAST, size())
            if found >= 2 * looked_at:
                gc.unfreeze()
                looked_at = found
            elif found < GROWTH * left_out:
                if gc.get_count()[2] >= FULL_GC_AFTER:
                    gc.collect()
                continue
            gc.collect()
            gc.freeze()
            left_out = found
    finally:
        gc.unfreeze()
        gc.set_threshold(*usual)
