"""Old rows are deleted in bounded steps, however slow that is."""

import asyncio
from functools import partial

import pytest
from sqlalchemy import text
from sqlalchemy.ext.asyncio import AsyncConnection

from services.monitor.history import store as module
from services.monitor.history.engine import translating
from services.monitor.history.row_maintenance import Pruning
from tests.services.monitor.history.support.monitoring import kept, monitoring
from tests.services.monitor.history.test_store import opened
from tests.services.monitor.inventory.seeing import S
from tests.waiting import until

UNHEARD_S = 4.0  # long enough for heartbeats on a busy machine
ENDLESS = {
    "sqlite": "WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n) SELECT count(*) FROM n",
    "postgresql": "SELECT pg_sleep(3600)",
}


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> asyncio.Event:
    """Have pruning be a statement without an end, for which the database has an hour; tell when it begins."""
    begun = asyncio.Event()

    async def endless(connection: AsyncConnection) -> bool:
        begun.set()
        await connection.execute(text(ENDLESS[connection.dialect.name]))
        return True

    monkeypatch.setattr(Pruning, "steps", lambda *_: [endless])
    monkeypatch.setattr(module, "translating", partial(translating, 3_600.0))
    return begun


async def test_while_pruning_is_slow_history_is_written_and_the_lead_stays(
    url: str, begun: asyncio.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "UNHEARD_S", UNHEARD_S)
    async with monitoring(url) as leader, monitoring(url) as other, opened(url) as store, asyncio.timeout(60):
        await begun.wait()
        began_ns = await store.heartbeat_ns()
        while await store.heartbeat_ns() < began_ns + 2 * UNHEARD_S * S:  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0.1)
        leader.see(1, box=1)
        await until(leader.written)
        assert (leader.history.status.leads, other.history.status.leads) == (True, False)
        assert leader.history.status.problem == ""
        assert len(leader.led) == 1, "it led all along"


async def test_a_monitor_that_ends_waits_for_no_pruning_and_writes_what_was_last(
    url: str, begun: asyncio.Event
) -> None:
    async with asyncio.timeout(60):
        async with monitoring(url) as monitor:
            await begun.wait()
            monitor.see(1, box=1)
    assert [each.name for each in await kept(url)] == ["box"]
