"""Databases that cannot be had, are full, or hold what is not ours."""

import asyncio
import resource
from pathlib import Path

import pytest
from sqlalchemy import update

from services.monitor.history.presence import Presence
from services.monitor.history.state import HistoryError
from services.monitor.history.store import Store
from services.monitor.history.tables import (
    intervals,
    presence,
)
from tests.services.monitor.history.support.postgresql import PostgreSQL
from tests.services.monitor.history.support.stored_intervals import there
from tests.services.monitor.history.test_store import every, interval, opened
from tests.services.monitor.inventory.seeing import S


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
        await store.write([there(1, 2)], [], 2 * S)
        async with store._connection.begin():
            await store._connection.execute(update(presence).values(robot="<b>"))
        with pytest.raises(HistoryError, match="robot name '<b>'"):
            await store.select(Presence)
        with pytest.raises(HistoryError, match="robot name '<b>'"):
            await store.last_present()
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
