"""Maintenance of a history: deletes old rows, unless the clock is doubted."""

import logging
import time
from typing import Final

from services.monitor.history.clock_trust import DAY_NS, FAR_NS, ClockTrust, Correction
from services.monitor.history.errors import HistoryError
from services.monitor.history.store import Store

log = logging.getLogger(__name__)

PRUNE_S: Final = 3_600.0
RETRY_S: Final = 60.0


class Upkeep:
    """Deletes old history on a connection of its own: where that fails, the history is still written."""

    def __init__(self, url: str, days: float) -> None:
        self._url = url
        self._kept_ns = round(days * DAY_NS)
        self._clock = ClockTrust(max(DAY_NS, min(FAR_NS, self._kept_ns)))
        self._is_trusted = False
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
        """Check the clock before a write; return the correction to apply here, as applied in the database.

        The database knows while the clock is in doubt, since what is written then says nothing of when that was.
        """
        doubted = self._clock.doubt
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
            log.info("the clock of this machine is believed again")
        return correction

    async def prune(self, now_ns: int) -> None:
        """Delete some old rows, if due; raises nothing."""
        if self._clock.doubt is not None or time.monotonic() < self._due_s:
            return
        self._due_s = time.monotonic() + RETRY_S
        try:
            if self._store is None:
                self._store = await Store.open(self._url, create=False)
            whole = await self._store.prune(now_ns - self._kept_ns)
        except HistoryError as error:
            if not self._problem:
                log.warning("old history is not forgotten: %s", error)
            self._problem = f"old history is not forgotten: {error}; it is tried again every {RETRY_S:.0f} s"
            await self.close()
            return
        self._problem = ""
        self._due_s = time.monotonic() + PRUNE_S if whole else 0.0
        if whole:
            await self.close()

    async def close(self) -> None:
        """Close the database; raises nothing."""
        store, self._store = self._store, None
        if store is not None:
            await store.close()


def _steady_ns() -> int:
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)
