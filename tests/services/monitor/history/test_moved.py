"""An SQLite history whose files are moved, deleted or replaced while a monitor runs, and its users with it."""

import logging
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import inspect, text

from services.monitor.history import writer as module
from services.monitor.history.state import HistoryError
from services.monitor.history.store import Store
from services.monitor.history.tables import SCHEMA_VERSION, metadata
from services.monitor.web.auth.logins import Access
from services.monitor.web.auth.users import Kind
from tests.services.monitor.history.database.test_engine import names
from tests.services.monitor.history.database.test_opening import changing, numbers
from tests.services.monitor.history.support.monitoring import Monitor, kept, monitoring
from tests.services.monitor.history.test_store import every, interval, opened
from tests.services.monitor.inventory.seeing import S
from tests.services.monitor.web.serving import PASSWORD, access_in, users_in
from tests.waiting import until


@asynccontextmanager
async def in_use(folder: Path) -> AsyncIterator[tuple[Monitor, Access, str]]:
    """Have a monitor keep its history where its users are, and one of them be logged in; return the session."""
    async with monitoring(users_in(folder)) as monitor:
        access = await access_in(folder)
        session = await access.log_in("operator", PASSWORD, "a")
        await access.look()
        monitor.see(1, box=1)
        await until(monitor.written)
        yield monitor, access, session


def gone(monitor: Monitor) -> Callable[[], bool]:
    return lambda: monitor.history.status.problem.endswith("users.db: it does not exist")


def move(files: Iterable[Path], to: Path) -> None:
    to.mkdir(exist_ok=True)
    for file in list(files):
        file.rename(to / file.name)


async def test_a_file_that_was_deleted_is_said_and_nobody_is_logged_out(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    async with in_use(folder) as (monitor, access, session):
        for file in folder.iterdir():
            file.unlink()
        await until(gone(monitor))
        monitor.see(2, box=2)
        await access.look()
        assert access.problem.endswith("users.db: it does not exist")
        assert access.visitor(session, Kind.SESSION) is not None
        assert not access.needs_setup
        status = monitor.history.status
        assert (status.leads, status.pending > 0) == (True, True), "alerts go on, and rows wait"
        assert names(folder) == [], "an empty one would be there without users and without history"
    async with monitoring(users_in(folder)) as monitor:
        await until(lambda: monitor.history.status.leads)
        assert monitor.history.status.problem == "", "a monitor that begins makes one"


@pytest.mark.parametrize("which", ["*.db", "*"])
async def test_a_file_that_was_moved_and_is_back_has_what_came_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, which: str
) -> None:
    monkeypatch.setattr(module, "RETRY_S", 0.01)
    caplog.set_level(logging.INFO, module.__name__)
    folder, in_daemon_thread = tmp_path / "state", tmp_path / "aside"
    async with in_use(folder) as (monitor, access, session):
        move(folder.glob(which), in_daemon_thread)
        await until(gone(monitor))
        monitor.see(2, box=2)
        late = await access.log_in("viewer", PASSWORD, "a")
        await access.look()
        assert access.problem.startswith("log-ins are not being saved: ")
        move(in_daemon_thread.iterdir(), folder)
        await until(monitor.written)
        await access.look()
        assert (access.problem, monitor.history.status.lost) == ("", 0)
        assert access.visitor(session, Kind.SESSION) is not None
    assert [each.count for each in await kept(users_in(folder))] == [1, 2]
    assert (await access_in(folder)).visitor(late, Kind.SESSION) is not None
    said = [each for each in caplog.messages if each.startswith("history")]
    assert said == [f"history is not kept: {folder}/users.db: it does not exist", "history is kept again"]


async def test_a_link_that_is_moved_to_another_file_is_followed(tmp_path: Path) -> None:
    link, one, other = (tmp_path / name for name in ("link", "one.db", "other.db"))
    link.symlink_to(one)
    async with monitoring(f"sqlite:///{link}") as monitor:
        monitor.see(1, box=1)
        await until(monitor.written)
        assert one.stat().st_mode & 0o777 == 0o600
        async with opened(f"sqlite:///{other}") as store:
            await store.write([interval(1, 2)], [], 2 * S)
        (tmp_path / "new").symlink_to(other)
        (tmp_path / "new").replace(link)
        await until(lambda: bool(monitor.history.status.problem))
        monitor.see(2, box=3)
        await until(monitor.written)
    assert [each.count for each in await kept(f"sqlite:///{one}")] == [1]
    assert [each.count for each in await kept(f"sqlite:///{other}")] == [2, 1, 3]


@pytest.mark.parametrize("suffix", ["-wal", "-shm", "-lock"])
async def test_what_is_deleted_beside_a_file_costs_nothing(tmp_path: Path, suffix: str) -> None:
    file, beside = tmp_path / "history.db", tmp_path / f"history.db{suffix}"
    async with monitoring(f"sqlite:///{file}") as monitor:
        monitor.see(1, box=1)
        await until(monitor.written)
        beside.unlink()
        await until(lambda: bool(monitor.history.status.problem))
        monitor.see(2, box=2)
        await until(monitor.written)
        async with opened(f"sqlite:///{file}") as other:
            assert [each.count for each in await every(other)] == [1, 2]
            assert not await other.lead()


@pytest.mark.parametrize("which", ["*-lock", "*"])
async def test_of_two_monitors_one_leads_whatever_was_moved(tmp_path: Path, which: str) -> None:
    folder, in_daemon_thread = tmp_path / "state", tmp_path / "aside"
    async with monitoring(users_in(folder)) as one:
        await until(lambda: one.history.status.leads)
        async with monitoring(users_in(folder)) as other:
            await until(lambda: bool(other.history.status.leader))
            both = [one, other]
            move(folder.glob(which), in_daemon_thread)
            await until(lambda: bool(one.history.status.problem))
            if which == "*":
                await until(lambda: bool(other.history.status.problem))
                move(in_daemon_thread.iterdir(), folder)
            await until(lambda: sum(each.history.status.leads and each.written() for each in both) == 1)
            await until(lambda: sum(bool(each.history.status.leader) for each in both) == 1)
            assert [each.history.status.leads for each in both].count(True) == 1


async def test_what_is_written_as_the_file_is_moved_is_not_taken_for_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "history.db"
    put = Store._put

    async def putting(*some: Any) -> None:
        await put(*some)
        if file.exists():
            file.rename(tmp_path / "aside.db")

    async with opened(f"sqlite:///{file}") as store:
        monkeypatch.setattr(Store, "_put", putting)
        with pytest.raises(HistoryError, match=r"history\.db: it does not exist"):
            await store.write([interval(1, 2)], [], 2 * S)


async def test_tables_that_are_gone_are_waited_for_and_not_made_anew(url: str) -> None:
    async with monitoring(url) as monitor:
        monitor.see(1, box=1)
        await until(monitor.written)
        async with changing(url) as connection:
            await connection.run_sync(metadata.drop_all)
        await until(lambda: monitor.history.status.problem.endswith("no monitor has kept anything there"))
        monitor.see(2, box=2)
        async with changing(url) as connection:
            assert await connection.run_sync(lambda of: inspect(of).get_table_names()) == []
            await connection.run_sync(metadata.create_all)
        await until(monitor.written)
    assert [each.count for each in await kept(url)] == [1, 2]


async def test_a_table_that_came_later_is_made_in_an_older_backup(url: str) -> None:
    async with monitoring(url) as monitor:
        await until(monitor.written)
        async with changing(url) as connection:
            await connection.execute(text("DROP TABLE forgotten"))
        await until(lambda: "forgotten" in monitor.history.status.problem)
        monitor.see(1, box=1)
        await until(monitor.written)
    assert await numbers(url) == [SCHEMA_VERSION]
