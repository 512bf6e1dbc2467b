"""Maintenance of a history: deletes old rows, unless the clock is doubted."""

import asyncio
import logging
import time
from typing import Final

from services.monitor.history.clock_trust import DAY_NS, FAR_NS, ClockTrust, Correction
from services.monitor.history.state import HistoryError
from services.monitor.history.store import Store

log = logging.getLogger(__name__)

PRUNE_S: Final = 3_600.0
RETRY_S: Final = 60.0
CORRECT_S: Final = 2.0
"""How long history is corrected before the monitor may end: the next one goes on with it."""

BREAK_OFF_S: Final = 0.05
"""How often a step that is under way when the monitor ends is broken off: it may have been between two statements."""


class Upkeep:
    """Forgets old history on a connection of its own: where that is slow or fails, history is kept all the same."""

    def __init__(self, url: str, days: float) -> None:
        self._url = url
        self._kept_ns = round(days * DAY_NS)
        self._clock = ClockTrust(max(DAY_NS, min(FAR_NS, self._kept_ns)))
        self._is_trusted = False
        self._is_corrected = False
        self._believed_ns = 0
        self._looked = asyncio.Event()
        self._ends = False
        self._store: Store | None = None
        self._due_s = 0.0
        self._problem = ""

    def problems(self) -> tuple[str, ...]:
        """Return why old history is not deleted, in lines."""
        doubt = self._clock.doubt
        return tuple(each for each in ("" if doubt is None else str(doubt), self._problem) if each)

    def trust_clock(self) -> None:
        """Trust the clock."""
        self._is_trusted = True

    async def begin(self, store: Store) -> None:
        """Take over where a monitor stopped, before anything is written."""
        kept_ns, (doubt, _) = await store.heartbeat_ns(), await store.clock_doubt()
        self._clock.begin(kept_ns, doubt, _steady_ns())
        if doubt is None and self._clock.doubt is not None:
            await store.write_clock_doubt(self._clock.doubt)

    async def check_clock(self, store: Store, now_ns: int) -> Correction | None:
        """Look at the clock before anything is written; return what is to be corrected here as it is in the database.

        The database knows while the clock is in doubt, since what is written then says nothing of when that was.
        """
        doubted, self._believed_ns = self._clock.doubt, 0
        correction = self._clock.advance(now_ns, _steady_ns())
        if self._clock.doubt is not None:
            if self._clock.doubt is not doubted:
                log.warning("%s", self._clock.doubt)
                await store.write_clock_doubt(self._clock.doubt)
            if self._is_trusted or (await store.clock_doubt())[1]:
                correction = self._clock.trust()
        self._is_trusted = False
        if self._clock.doubt is None and doubted is not None:
            await store.end_clock_doubt(correction)
            self._is_corrected = False
            log.info("the clock of this machine is trusted again")
        self._believed_ns = 0 if self._clock.doubt is not None else now_ns
        self._looked.set()
        return correction

    async def correct(self, store: Store) -> bool:
        """Correct what was kept by a clock that was ahead, for a while; return whether that was all.

        Until then nothing may be written: it would be taken for a part of that.
        """
        until_s = time.monotonic() + CORRECT_S
        while not self._is_corrected and time.monotonic() < until_s:
            self._is_corrected = not await store.correct()
        return self._is_corrected

    def pause(self) -> None:
        """Forget nothing more until the clock is looked at again: history is not being kept."""
        self._believed_ns, self._is_corrected = 0, False

    async def run(self) -> None:
        """Forget what is old until cancelled; a database that is slow at it holds up nothing else."""
        try:
            while True:
                await self._looked.wait()
                self._looked.clear()
                if self._believed_ns and time.monotonic() >= self._due_s:
                    await self._prune_or_break_off(self._believed_ns)
        finally:
            await self._close()

    async def _prune_or_break_off(self, now_ns: int) -> None:
        pruning = asyncio.ensure_future(self._prune(now_ns))
        try:
            await asyncio.wait([pruning])
        except asyncio.CancelledError:
            self._ends = True
            while not pruning.done():
                if self._store is not None and not await self._store.interrupt():
                    pruning.cancel()
                await asyncio.wait([pruning], timeout=BREAK_OFF_S)
            raise

    async def _prune(self, now_ns: int) -> None:
        """Forget some of what is old; raises nothing."""
        self._due_s = time.monotonic() + RETRY_S
        try:
            if self._store is None:
                self._store = await Store.open(self._url, create=False)
            whole = await self._store.prune(now_ns - self._kept_ns)
        except HistoryError as error:
            if not self._problem and not self._ends:
                log.warning("old history is not forgotten: %s", error)
            self._problem = f"old history is not forgotten: {error}; it is tried again every {RETRY_S:.0f} s"
            await self._close()
            return
        self._problem = ""
        self._due_s = time.monotonic() + PRUNE_S if whole else 0.0
        if whole:
            await self._close()

    async def _close(self) -> None:
        store, self._store = self._store, None
        if store is not None:
            await store.close()


def _steady_ns() -> int:
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)
