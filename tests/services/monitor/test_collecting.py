import asyncio
import gc
from contextlib import suppress

from services.monitor.collecting import LEAST, keep_collections_short


async def test_what_is_there_is_left_out_again_after_each_doubling_and_until_the_end() -> None:
    assert not gc.get_freeze_count()
    sizes = iter([1, LEAST, 2 * LEAST - 1, 2 * LEAST, 4 * LEAST])
    frozen: list[bool] = []

    def size() -> int:
        frozen.append(gc.get_freeze_count() > 0)
        gc.unfreeze()
        return next(sizes, 0)

    keeping = asyncio.create_task(keep_collections_short(size, period_s=0))
    async with asyncio.timeout(60):
        while len(frozen) < 6:  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0)
    keeping.cancel()
    with suppress(asyncio.CancelledError):
        await keeping
    assert frozen[:6] == [False, True, False, False, True, True]
    assert not gc.get_freeze_count()
