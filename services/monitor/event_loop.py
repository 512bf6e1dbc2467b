"""Keeps the event loop responsive: yielding, daemon threads, short garbage collections, values made once for all."""

import asyncio
import contextlib
import gc
import threading
import time
from collections.abc import AsyncIterable, AsyncIterator, Awaitable, Callable, Coroutine, Iterable
from typing import Final, Generic, TypeVar

AT_ONCE: Final = 100
"""Arrivals handled before other tasks get a turn."""

TURN_S: Final = 0.003
"""Seconds of work before other tasks get a turn: requests wait for several turns."""

PAUSE_S: Final = 0.001
"""Seconds for which the loop sleeps, so that other threads, such as the bus's, get the interpreter at once."""

T = TypeVar("T")


async def pause() -> None:
    """Let other tasks and threads run."""
    await asyncio.sleep(PAUSE_S)


async def in_turns(items: Iterable[T]) -> AsyncIterator[T]:
    """Yield items; other tasks and threads run after each `TURN_S`."""
    began_s = time.perf_counter()
    for item in items:
        yield item
        if time.perf_counter() - began_s > TURN_S:
            await pause()
            began_s = time.perf_counter()


async def arrivals_in_turns(arrivals: AsyncIterable[T]) -> AsyncIterator[T]:
    """Yield arrivals; under load other tasks get regular turns, as nothing is awaited then."""
    number = 0
    async for arrival in arrivals:
        yield arrival
        number += 1
        if number % AT_ONCE == 0:
            await asyncio.sleep(0)


async def in_daemon_thread(act: Callable[[], object]) -> None:
    """Run a function on its own daemon thread, which is abandoned on cancellation and never keeps the process alive."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()

    def settle(error: BaseException | None) -> None:
        if done.done():
            return
        if error is None:
            done.set_result(None)
        else:
            done.set_exception(error)

    def run() -> None:
        failed: BaseException | None = None
        try:
            act()
        except BaseException as error:  # noqa: BLE001 - it is raised where the result is awaited
            failed = error
        with contextlib.suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(settle, failed)

    threading.Thread(target=run, name="blocking-call", daemon=True).start()
    await done


PERIOD_S: Final = 10.0
LEAST: Final = 100
GROWTH: Final = 1.125
"""By how much there is more when what is new is left out too: until then collections look at it."""

GC_GEN0_THRESHOLD: Final = 1_500
"""How many new objects are looked at, at once: a millisecond or two."""

GC_GEN1_THRESHOLD: Final = 1
"""How many times that until those that stayed are looked at with them."""

GC_GEN2_DISABLED: Final = 1_000_000_000
FULL_GC_AFTER: Final = 50
"""After how many of those what is old is looked at: a tenth of a second, after more than a hundred pages."""


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


async def uninterrupted(work: Coroutine[None, None, float]) -> float:
    """Await work to its end despite cancellation: an aborted statement may leave its database locked."""
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


V = TypeVar("V")


class CachedValue(Generic[V]):
    """A value that takes a while to make: callers get one no older than `max_age_s`, or wait for it.

    share: of the time, that making it may take. What takes less is made anew sooner than after `max_age_s`.
    """

    def __init__(self, make: Callable[[], Awaitable[V]], max_age_s: float, *, share: float = 0.0) -> None:
        self._make = make
        self._max_age_s = max_age_s
        self._share = share
        self._took_s = 0.0
        self._made: tuple[float, V] | None = None
        self._failed: tuple[float, Exception] | None = None
        self._making = asyncio.Lock()

    async def get(self) -> V:
        """Return the value; an error in making it goes to all who waited meanwhile, so that none waits twice."""
        asked_s = time.monotonic()
        async with self._making:
            if self._failed is not None and asked_s <= self._failed[0]:
                raise self._failed[1]
            began_s = time.monotonic()
            if self._made is None or self._is_old(began_s - self._made[0]):
                try:
                    self._made = (began_s, await self._make())
                except Exception as error:
                    self._failed = (time.monotonic(), error)
                    raise
                self._took_s = time.monotonic() - began_s
            return self._made[1]

    def _is_old(self, age_s: float) -> bool:
        return age_s > self._max_age_s or self._took_s < self._share * age_s
