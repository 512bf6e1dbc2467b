"""Every query at ten times the history that docs/monitor.md promises, each within the time limit of a query."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Final

import pytest
from sqlalchemy import func, select, text
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from schemas.alerts import AlertState
from services.monitor.history import archive as archive_module
from services.monitor.history import row_maintenance
from services.monitor.history.archive import Archive, HistoryQuery, WorldQuery
from services.monitor.history.counting import SLOTS
from services.monitor.history.intervals import Disagreement, Interval
from services.monitor.history.opening import connect
from services.monitor.history.presence import Presence
from services.monitor.history.store import Store
from services.monitor.history.tables import metadata, presence
from tests.services.monitor.history.support.filling import ROBOTS, fill
from tests.services.monitor.history.test_store import opened
from tests.services.monitor.inventory.seeing import S

NOW_S: Final = 1_700_000_000
DAYS_S: Final = 30 * 86_400

ROWS: Final = {
    "intervals": 1_000_000,
    "presence": 200_000,
    "disagreements": 100_000,
    "stock": 100_000,
    "object_events": 200_000,
    "alerts": 300_000,
    "acts": 10_000,
    "forgotten": 20_000,
    "poses": 20_000,
}


STEPS: Final = 1_000
READ: Final = "SELECT seq_tup_read + coalesce(idx_tup_fetch, 0) FROM pg_stat_user_tables WHERE relname = 'intervals'"


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


async def rows_read(url: str, store: Store) -> int:
    """Return how many intervals PostgreSQL has read so far, once all others' connections have told; 0 for SQLite."""
    if url.startswith("sqlite"):
        return 0
    async with store._connection.begin():
        await store._connection.execute(text("SELECT pg_stat_clear_snapshot()"))
        return int(await store._connection.scalar(text(READ)) or 0)


def counted_steps(patch: pytest.MonkeyPatch) -> list[int]:
    """Have SQLite count STEPS of its instructions as one, in what an archive reads."""
    steps: list[int] = []

    async def counting(engine: AsyncEngine, *, create: bool) -> AsyncConnection:
        connection = await connect(engine, create=create)
        database = (await connection.get_raw_connection()).driver_connection
        if engine.dialect.name == "sqlite" and database is not None:
            await database.set_progress_handler(lambda: steps.append(1), STEPS)
        return connection

    patch.setattr(archive_module, "connect", counting)
    return steps


async def test_a_long_history_of_which_all_is_old_is_pruned_step_by_step(url: str) -> None:
    async with opened(url) as store:
        rows = {name: count for name, count in ROWS.items() if name != "intervals"}
        for table, count in rows.items():
            await fill(store, table, count, NOW_S - DAYS_S, NOW_S)
        before, steps = sum(rows.values()), 0
        while not await store.prune(2**62):
            left = sum((await counted(store)).values())
            assert before - left <= len(rows) * row_maintenance.SLICE
            before, steps = left, steps + 1
        assert steps >= ROWS["alerts"] // 2 // row_maintenance.SLICE
        unresolved = ROWS["alerts"] // 100
        assert await counted(store) == {
            **dict.fromkeys(ROWS, 0), "alerts": unresolved, "acts": ROWS["acts"] // 100
        }  # fmt: skip


async def test_every_query_of_a_long_history_is_answered(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    async with long_history(url) as store:
        kept = await store.load((NOW_S - 86_400) * S)
        assert (len(kept.alerts), len(kept.acts)) == (ROWS["alerts"] // 100, ROWS["acts"] // 100)
        assert len(await store.last_present()) == 2 * ROBOTS
        assert len(await store.poses((NOW_S - DAYS_S) * S)) == len(await store.forgotten()) == 20_000
        names = [f"alert-of-a-long-history-{number}" for number in range(10_000)]
        assert len(await store.known_alerts(names)) == len(names)
        for kind, where in ((Interval, []), (Presence, [presence.c.robot != ""]), (Disagreement, [])):
            assert await store.select(kind, *where, since_ns=(NOW_S - 86_400) * S)
        archive, day = Archive(url), HistoryQuery((NOW_S - 86_400) * S, NOW_S * S)
        for asked in (
            day,
            HistoryQuery(),
            HistoryQuery(text="r7"),
            HistoryQuery(day.since_ns, day.until_ns, text="ü"),
            HistoryQuery(name="none"),
            HistoryQuery(robot="r1"),
            HistoryQuery(camera="x"),
        ):
            found = await archive.sightings(asked, 200)
            assert len(found) in {0, 200}, asked
        assert len(await archive.alerts(HistoryQuery(), 10_000, states=[AlertState.RAISED])) == ROWS["alerts"] // 100
        assert len(await archive.alerts(day, 200, states=[AlertState.RESOLVED])) == 200
        assert len(await archive.alerts(HistoryQuery(robot="r3"), 200)) == 200
        assert len(await archive.acts(names)) == len(names)
        for since_s in (3_600, 86_400, DAYS_S):
            counts = await archive.counts(HistoryQuery((NOW_S - since_s) * S, NOW_S * S))
            assert counts.most.keys() == {"box", "pallet", "forklift"}
            none = await archive.counts(HistoryQuery((NOW_S - since_s) * S, NOW_S * S, robot="r3", text="ü"))
            assert none.most == {}
        one = await archive.counts(HistoryQuery((NOW_S - DAYS_S) * S, NOW_S * S, robot="r3", name="box"))
        assert len(one.most["box"]) == SLOTS, "one robot's are counted exactly"
        month = WorldQuery((NOW_S - DAYS_S) * S, NOW_S * S, site="hall")
        for world in (month, WorldQuery(), replace(month, name="box"), replace(month, since_ns=(NOW_S - 60) * S)):
            assert len(await archive.stock(world, 200)) in range(1, 201)
            assert len(await archive.object_events(world, 200)) in range(1, 201)
        assert len(await archive.object_events(WorldQuery(site="hall", object="o7"), 200)) == 10
        held = await archive.stock_counts(replace(month, zone="zone 3"))
        assert held.most.keys() == {"box", "pallet", "forklift"}
        before = await rows_read(url, store)
        with monkeypatch.context() as patch:
            steps = counted_steps(patch)
            await archive.counts(HistoryQuery((NOW_S - DAYS_S) * S, NOW_S * S))
        read = await rows_read(url, store) - before
        assert read < ROWS["intervals"] / 4, "of PostgreSQL's rows"
        assert len(steps) * STEPS < 8 * ROWS["intervals"], "of SQLite's instructions, of which a row takes twenty"
        await store.prune((NOW_S - DAYS_S) * S)
        assert await store.prune((NOW_S - DAYS_S) * S)
        assert await counted(store) == ROWS, "nothing was old"
