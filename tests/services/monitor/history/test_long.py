"""Every query at ten times the history that docs/monitor.md promises, each within the time limit of a query."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Final

from sqlalchemy import func, select

from services.monitor.history.store import Store
from services.monitor.history.tables import metadata
from tests.services.monitor.history.filling import fill
from tests.services.monitor.history.test_store import opened
from tests.services.monitor.inventory.seeing import S

NOW_S: Final = 1_700_000_000
DAYS_S: Final = 30 * 86_400

ROWS: Final = {
    "intervals": 1_000_000,
    "presence": 200_000,
    "disagreements": 100_000,
    "alerts": 300_000,
    "acts": 10_000,
    "forgotten": 20_000,
    "poses": 20_000,
}


@asynccontextmanager
async def long_history(url: str) -> AsyncIterator[Store]:
    async with opened(url) as store:
        for table, count in ROWS.items():
            await fill(store, table, count, NOW_S - DAYS_S, NOW_S)
        await store.write([], [], NOW_S * S)
        yield store


async def counted(store: Store) -> dict[str, int]:
    async with store._connection.begin():
        return {
            name: await store._connection.scalar(select(func.count()).select_from(metadata.tables[name])) or 0
            for name in ROWS
        }


async def test_a_long_history_of_which_nothing_is_old_is_pruned_and_stays(url: str) -> None:
    async with long_history(url) as store:
        for _ in range(ROWS["acts"] // 10_000):
            await store.prune((NOW_S - DAYS_S) * S)
        assert await store.prune((NOW_S - DAYS_S) * S)
        assert await counted(store) == ROWS
