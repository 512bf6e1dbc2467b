"""Awaiting work to its end."""

import asyncio
from collections.abc import Coroutine


async def uninterrupted(work: Coroutine[None, None, float]) -> float:
    """Await work to its end, however often cancelled: a statement that is broken off may leave its database locked."""
    task = asyncio.ensure_future(work)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.wait([task])
        except asyncio.CancelledError as error:
            cancelled = error
    if cancelled is not None:
        raise cancelled from task.exception()
    return task.result()
