"""Monitoring goes on while the database is gone, full or not there yet, and the history catches up."""

import asyncio
import logging
import resource
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from schemas.alerts import AlertState
from services.monitor.history import writer as module
from services.monitor.history.presence import MONITOR
from services.monitor.history.state import HistoryError
from services.monitor.history.store import Store
from tests.schemas.results import alert
from tests.services.monitor.history.support.monitoring import Monitor, attended, kept, monitoring, noted
from tests.services.monitor.history.support.postgresql import PostgreSQL
from tests.services.monitor.inventory.seeing import S
from tests.waiting import until


async def test_with_the_database_gone_monitoring_goes_on_and_nothing_is_lost(postgresql: PostgreSQL) -> None:
    url = postgresql.create("gone_and_back")
    async with monitoring(url) as monitor:
        monitor.see(1, box=1)
        await until(monitor.written)
        await asyncio.to_thread(postgresql.stop)
        await until(lambda: bool(monitor.history.status.problem))
        assert monitor.history.status.leads, "alerts go on"
        monitor.see(2, box=2)
        monitor.see(3)
        for alive in (True, False):
            monitor.inventory.robot_presence("r1", alive=alive)
            await noted(monitor)
        monitor.history.alert(alert(state=AlertState.RESOLVED))
        await asyncio.to_thread(postgresql.start)
        await until(monitor.written)
    (gone,) = await attended(url, ("r1", ""))
    assert (gone.open, gone.until_ns > gone.since_ns) == (False, True)
    assert len(await attended(url, MONITOR)) == 1, "it led all along"
    one, two = await kept(url)
    assert (one.count, one.open, two.count, two.open) == (1, False, 2, False)
    assert one.until_ns == two.since_ns


@asynccontextmanager
async def away(monitor: Monitor) -> AsyncIterator[None]:
    """Have the database be gone for a while."""

    async def refuse(*_: Any) -> None:
        raise HistoryError("gone")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Store, "write", refuse)
        await until(lambda: monitor.history.status.problem == "gone")
        yield
    await until(monitor.written)


async def test_a_database_that_is_gone_and_back_is_a_line_each_in_the_log(
    url: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "RETRY_S", 0.01)
    tries = 0

    async def refuse(*_: Any) -> None:
        nonlocal tries
        tries += 1
        raise HistoryError("gone")

    caplog.set_level(logging.INFO, module.__name__)
    async with monitoring(url) as monitor:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Store, "write", refuse)
            await until(lambda: tries > 2)
        monitor.see(1, box=1)
        await until(monitor.written)
    assert caplog.messages == ["history is not kept: gone", "history is kept again"]


async def test_who_came_back_soon_after_the_database_had_been_gone(url: str) -> None:
    async with monitoring(url) as monitor:
        monitor.inventory.robot_presence("r1", alive=True)
        await noted(monitor)
        await until(monitor.written)
        async with away(monitor):
            monitor.inventory.robot_presence("r1", alive=False)
            await noted(monitor)
        monitor.inventory.robot_presence("r1", alive=True)
        await noted(monitor)
    before, after = await attended(url, ("r1", ""))
    assert (before.open, after.open, before.until_ns < after.since_ns) == (False, True, True)


async def test_what_ended_as_a_camera_fell_silent_does_not_go_on_when_the_database_had_been_gone(url: str) -> None:
    async with monitoring(url) as monitor:
        then_ns = time.time_ns() - 10 * S
        monitor.see(1, then_ns, box=1)
        await until(monitor.written)
        async with away(monitor):
            pass
    (box,) = await kept(url)
    assert (box.since_ns, box.until_ns, box.open) == (then_ns, then_ns, False)


async def test_with_the_disk_full_monitoring_goes_on_and_history_comes_back(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/history.db"
    async with monitoring(url) as monitor:
        monitor.see(1, box=1)
        await until(monitor.written)
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
        try:
            for seq in range(2, 2_000):
                monitor.see(seq, box=seq)
            await until(lambda: "disk" in monitor.history.status.problem)
            monitor.see(2_000, box=1)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        await until(monitor.written)
    assert [each.count for each in await kept(url)] == [*range(1, 2_000), 1]


async def test_a_database_that_is_not_there_yet_keeps_no_monitor_from_beginning(tmp_path: Path) -> None:
    (tmp_path / "new").write_text("in the way")
    url = f"sqlite:///{tmp_path}/new/history.db"
    async with monitoring(url) as monitor:
        assert "exists" in monitor.history.status.problem or "directory" in monitor.history.status.problem
        assert (monitor.history.status.leads, monitor.led) == (True, [[]])
        monitor.see(1, box=1)
        (tmp_path / "new").unlink()
        await until(monitor.written)
    assert [each.count for each in await kept(url)] == [1]
