"""Full garbage collections that do not grow with the fleet: they stop everything, for 0.2 s with 5,000 cameras."""

import asyncio
import gc
from collections.abc import Callable
from typing import Final

PERIOD_S: Final = 10.0
LEAST: Final = 100


async def keep_collections_short(size: Callable[[], int], *, period_s: float = PERIOD_S) -> None:
    """Leave out of collections what is there for good, for ever. size: how much there is, in any unit.

    What there is is looked at once in a while, and again after each doubling, so that little garbage is left out too.
    """
    enough = 0
    try:
        while True:
            await asyncio.sleep(period_s)
            if (found := size()) >= enough:
                enough = 2 * max(LEAST, found)
                gc.unfreeze()
                gc.collect()
                gc.freeze()
    finally:
        gc.unfreeze()
