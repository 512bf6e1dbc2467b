import asyncio
import resource
import sqlite3
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from pathlib import Path

import pytest
from sqlalchemy import update
from sqlalchemy.dialects import sqlite

from schemas.alerts import AlertState
from schemas.keys import CameraKey
from services.monitor.history.errors import HistoryError
from services.monitor.history.intervals import Interval
from services.monitor.history.store import SLICE_NS, Store
from services.monitor.history.tables import intervals
from tests.schemas.results import alert
from tests.services.monitor.history.postgresql import PostgreSQL
from tests.services.monitor.inventory.seeing import FRONT, S


def interval(
    since_s: int, until_s: int, *, key: CameraKey = FRONT, is_open: bool = False, name: str = "box"
) -> Interval:
    return Interval(key, name, since_s * S, until_s * S, is_open, 2, 0.5, 1.25, since_s * S, "m", "w")


@asynccontextmanager
async def opened(url: str) -> AsyncIterator[Store]:
    store = await Store.open(url)
    try:
        yield store
    finally:
        await store.close()


async def every(store: Store) -> list[Interval]:
    return [found async for found in store.select()]


async def test_what_was_written_is_there_for_the_next_process(url: str) -> None:
    async with opened(url) as store:
        assert await store.heartbeat_ns() == 0
        await store.write([interval(1, 2), interval(3, 4, is_open=True)], [alert()], 9 * S)
    async with opened(url) as store:
        assert await every(store) == [interval(1, 2), interval(3, 9, is_open=True)]
        kept = await store.load(0)
        assert kept.intervals == [interval(3, 9, is_open=True)]
        assert kept.alerts == [alert()]


async def test_writing_again_changes_what_is_there(url: str) -> None:
    async with opened(url) as store:
        await store.write([interval(1, 2, is_open=True)], [alert()], 2 * S)
        resolved = alert(state=AlertState.RESOLVED)
        await store.write([interval(1, 5)], [resolved], 6 * S)
        assert await every(store) == [interval(1, 5)]
        kept = await store.load(6 * S)
        assert (kept.intervals, kept.alerts) == ([], [])
        assert (await store.load(5 * S)).intervals == [interval(1, 5)]


async def test_texts_that_a_database_would_refuse_are_kept_legible(url: str) -> None:
    async with opened(url) as store:
        odd = "bo\0x'; DROP TABLE intervals --箱" + "x" * 200
        await store.write([interval(1, 2, name=odd)], [], 2 * S)
        (found,) = await every(store)
        assert found.name == odd.replace("\0", "␀")


async def test_one_of_two_leads_until_it_goes(url: str) -> None:
    async with opened(url) as second:
        async with opened(url) as first:
            assert await first.lead()
            assert await first.lead()
            assert not await second.lead()
        assert await second.lead()


async def test_old_history_is_forgotten_but_not_what_goes_on(url: str) -> None:
    async with opened(url) as store:
        old = [interval(1, 2), interval(3, 4, is_open=True), interval(5, 10)]
        await store.write(old, [alert(), alert(id_="b", state=AlertState.RESOLVED)], 10 * S)
        await store.prune(10 * S)
        assert await every(store) == [interval(3, 10, is_open=True), interval(5, 10)]
        await store.prune(2**62)
        assert await every(store) == [interval(3, 10, is_open=True)]
        assert [each.id for each in (await store.load(0)).alerts] == [alert().id]


async def test_much_old_history_is_forgotten_bit_by_bit(url: str) -> None:
    hour = SLICE_NS // S
    async with opened(url) as store:
        assert await store.prune(9 * S)
        await store.write([interval(end, end) for end in (2, hour, 2 * hour + 2)])
        assert not await store.prune(9 * SLICE_NS)
        assert await every(store) == [interval(2 * hour + 2, 2 * hour + 2)]
        assert not await store.prune(9 * SLICE_NS)
        assert await every(store) == []
        assert await store.prune(9 * SLICE_NS)


async def test_what_goes_on_is_found_without_a_look_at_all_history(tmp_path: Path) -> None:
    file = tmp_path / "history.db"
    async with opened(f"sqlite:///{file}"):
        pass
    with closing(sqlite3.connect(file)) as database:
        database.execute("DROP INDEX intervals_open")  # as in a database of a release before
        database.commit()
    async with opened(f"sqlite:///{file}"):
        pass
    asked = intervals.select().where(intervals.c.open).compile(dialect=sqlite.dialect())
    with closing(sqlite3.connect(file)) as database:
        (plan,) = database.execute(f"EXPLAIN QUERY PLAN {asked}").fetchall()
    assert "USING INDEX intervals_open" in plan[-1]


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ("mysql://somebody@127.0.0.1/db", "not the URL of a database"),
        ("sqlite:////proc/nowhere/history.db", "nowhere"),
        ("postgresql://somebody@127.0.0.1:1/db", "refused|Connect"),
    ],
)
async def test_a_database_that_cannot_be_had_is_one_line(bad: str, reason: str) -> None:
    with pytest.raises(HistoryError, match=reason) as raised:
        await Store.open(bad)
    assert "\n" not in str(raised.value)


async def test_rows_that_are_not_ours_are_an_error(url: str) -> None:
    async with opened(url) as store:
        await store.write([interval(1, 2)], [], 2 * S)
        async with store._connection.begin():
            await store._connection.execute(update(intervals).values(robot="<b>"))
        with pytest.raises(HistoryError, match="robot name '<b>'"):
            await every(store)


async def test_a_full_disk_is_an_error_and_loses_nothing_that_was_kept(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/history.db"
    async with opened(url) as store:
        await store.write([interval(1, 2)], [], 2 * S)
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, hard))
        try:
            with pytest.raises(HistoryError, match="disk"):
                await store.write([interval(number, number + 1) for number in range(2, 5_000)], [], 3 * S)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    async with opened(url) as store:
        assert await every(store) == [interval(1, 2)]
        await store.write([interval(2, 3)], [], 3 * S)
        assert len(await every(store)) == 2


async def test_a_server_that_is_gone_is_an_error_and_may_come_back(postgresql: PostgreSQL) -> None:
    url = postgresql.create("restarted")
    async with opened(url) as store:
        assert await store.lead()
        await store.write([interval(1, 2)], [], 2 * S)
        await asyncio.to_thread(postgresql.stop)
        with pytest.raises(HistoryError):
            await store.write([interval(2, 3)], [], 3 * S)
    with pytest.raises(HistoryError):
        await Store.open(url)
    await asyncio.to_thread(postgresql.start)
    async with opened(url) as store:
        assert await store.lead()
        assert await every(store) == [interval(1, 2)]
