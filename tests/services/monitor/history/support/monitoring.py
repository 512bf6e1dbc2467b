"""A monitor's inventory and its history, and what the database has of it."""

import asyncio
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager

from schemas.alerts import Alert
from services.monitor.history.intervals import Interval
from services.monitor.history.presence import Presence, PresenceKey
from services.monitor.history.settings import HistorySettings
from services.monitor.history.state import Act
from services.monitor.history.writer import HistoryWriter
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.map.last_seen import SightingMap
from tests.services.monitor.history.test_store import every, opened
from tests.services.monitor.inventory.seeing import seen
from tests.waiting import until

LIMITS = TrustLimits(Debounce(1, 0, 1, 0))


class Monitor:
    """An inventory and its history."""

    def __init__(self, url: str) -> None:
        self.led: list[list[Alert]] = []
        self.inventory = Inventory(LIMITS)
        self.places = SightingMap()
        settings = HistorySettings(history=url)
        self.history = HistoryWriter(settings, self.inventory, self._lead, self.places)

    def _lead(self, alerts: Sequence[Alert], _acts: Sequence[Act], _since_ns: int) -> None:
        self.led.append(list(alerts))

    def see(self, seq: int, at_ns: int | None = None, /, **counts: int) -> None:
        changes = self.inventory.see(seen(seq, counts), at_ns or time.time_ns())
        assert changes is not None
        self.history.take(changes)

    def written(self) -> bool:
        status = self.history.status
        return not status.problem and status.pending == 0


@asynccontextmanager
async def monitoring(url: str) -> AsyncIterator[Monitor]:
    monitor = Monitor(url)
    await monitor.history.restore()
    running = asyncio.create_task(monitor.history.run())
    try:
        yield monitor
    finally:
        running.cancel()
        await asyncio.wait([running])


async def kept(url: str) -> list[Interval]:
    async with opened(url) as store:
        return await every(store)


async def attended(url: str, place: PresenceKey) -> list[Presence]:
    """Return when somebody was there."""
    async with opened(url) as store:
        return [each for each in await store.select(Presence) if each.place == place]


async def noted(monitor: Monitor) -> None:
    """Wait until what happened before is noted."""
    monitor.inventory.robot_presence("marker", alive=not monitor.inventory.is_alive("marker"))
    await until(lambda: "marker" not in monitor.history._attendance._news.robots)
