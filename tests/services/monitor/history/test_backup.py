"""`fleetsight history backup` and `restore`, with both databases."""

import asyncio
import os
import sqlite3
import stat
from contextlib import closing
from itertools import count
from pathlib import Path

import pytest
from pydantic import ValidationError

from services.monitor.history.backup import back_up, restore
from services.monitor.history.export import run
from services.monitor.history.settings import ExportSettings
from services.monitor.history.state import HistoryError
from services.monitor.history.store import Store
from tests.schemas.results import alert
from tests.services.monitor.history.support.postgresql import PostgreSQL
from tests.services.monitor.history.test_store import every, interval, opened
from tests.services.monitor.inventory.seeing import S

numbers = count()


@pytest.fixture
def another(url: str, tmp_path: Path, request: pytest.FixtureRequest) -> str:
    """An empty database of the same kind."""
    if url.startswith("sqlite"):
        return f"sqlite:///{tmp_path}/another/history.db"
    server: PostgreSQL = request.getfixturevalue("postgresql")
    return server.create(f"restored_{next(numbers)}")


async def fill(url: str, *, until: int = 3) -> None:
    store = await Store.open(url)
    try:
        await store.write([interval(at, at + 1) for at in range(1, until)], [alert()], 9 * S)
    finally:
        await store.close()


async def test_a_history_is_as_it_was_after_a_restore(
    url: str, another: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    await fill(url)
    copy = tmp_path / "copy"
    await run(ExportSettings(task="backup", history=url, to=copy))
    assert stat.S_IMODE(copy.stat().st_mode) == 0o600
    async with opened(url) as store:
        before = await every(store)
        await store.write([interval(7, 8)], [], 9 * S)
    await run(ExportSettings.model_validate({"task": "restore", "history": another, "from": copy}))
    async with opened(another) as store:
        assert await every(store) == before
        assert len(before) == 2
    assert ": 2 intervals\n" in capsys.readouterr().out


async def test_a_backup_is_of_one_moment_while_a_monitor_writes(url: str, another: str, tmp_path: Path) -> None:
    await fill(url)
    async with opened(url) as store:

        async def write() -> None:
            for at in range(1_000):
                await store.write([interval(at, at + 1, name="left"), interval(at, at + 1, name="right")], [], 9 * S)

        writing = asyncio.create_task(write())
        await asyncio.sleep(0.2)
        await back_up(url, tmp_path / "copy")
        assert not writing.done()
        writing.cancel()
        await asyncio.wait([writing])
    await restore(another, tmp_path / "copy")
    async with opened(another) as store:
        names = [each.name for each in await every(store)]
    assert names.count("left") == names.count("right") > 0


def hidden(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if path.name.startswith(".")]


async def test_an_earlier_backup_stays_until_the_next_is_whole(url: str, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    copy.write_text("earlier")
    with pytest.raises(HistoryError, match=r"does not exist|has kept anything"):
        await back_up(url, copy)
    assert copy.read_text() == "earlier"
    await fill(url)
    await back_up(url, copy)
    assert copy.read_bytes() != b"earlier"
    assert not hidden(tmp_path)


async def test_a_history_that_is_there_is_not_overwritten(url: str, tmp_path: Path) -> None:
    await fill(url)
    await back_up(url, tmp_path / "copy")
    await fill(url, until=5)
    with pytest.raises(HistoryError, match=r"move .* aside first|restore into an empty database"):
        await restore(url, tmp_path / "copy")
    async with opened(url) as store:
        assert len(await every(store)) == 4


async def test_a_file_that_is_no_backup_of_this_kind_is_refused(url: str, tmp_path: Path) -> None:
    (tmp_path / "text").write_text("hello")
    with pytest.raises(HistoryError, match="no backup"):
        await restore(url, tmp_path / "text")
    other = b"PGDMP" if url.startswith("sqlite") else b"SQLite format 3\0"
    (tmp_path / "other").write_bytes(other + bytes(100))
    with pytest.raises(HistoryError, match="a copy of"):
        await restore(url, tmp_path / "other")
    with pytest.raises(HistoryError, match="No such file"):
        await restore(url, tmp_path / "missing")


async def test_a_damaged_copy_leaves_no_database(tmp_path: Path) -> None:
    await fill(f"sqlite:///{tmp_path}/history.db", until=2_000)
    await back_up(f"sqlite:///{tmp_path}/history.db", tmp_path / "copy")
    with (tmp_path / "copy").open("r+b") as copy:
        copy.seek((tmp_path / "copy").stat().st_size // 2)
        copy.write(bytes(20_000))
    with pytest.raises(HistoryError):
        await restore(f"sqlite:///{tmp_path}/new.db", tmp_path / "copy")
    assert not (tmp_path / "new.db").exists()


async def test_any_other_database_of_sqlite_is_no_history(tmp_path: Path) -> None:
    with closing(sqlite3.connect(tmp_path / "other.db")) as other:
        other.execute("CREATE TABLE things (id INTEGER)")
    with pytest.raises(HistoryError, match="no monitor has kept anything there"):
        await back_up(f"sqlite:///{tmp_path}/other.db", tmp_path / "copy")
    with pytest.raises(HistoryError, match="no monitor has kept anything there"):
        await restore(f"sqlite:///{tmp_path}/new.db", tmp_path / "other.db")


async def test_it_says_where_postgresqls_programs_come_from(
    monkeypatch: pytest.MonkeyPatch, postgresql: PostgreSQL, tmp_path: Path
) -> None:
    url = postgresql.create(f"history_without_{next(numbers)}")
    await fill(url)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(HistoryError, match="pg_dump is not installed: it comes with Debian's package"):
        await back_up(url, tmp_path / "copy")


async def test_a_password_is_no_argument_of_a_program(
    monkeypatch: pytest.MonkeyPatch, postgresql: PostgreSQL, tmp_path: Path
) -> None:
    url = postgresql.create(f"history_secret_{next(numbers)}")
    await fill(url)
    program = tmp_path / "pg_dump"
    program.write_text('#!/bin/sh\necho "$@" "$PGPASSWORD" >"$(dirname "$0")/told"\nexit 1\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    with pytest.raises(HistoryError):
        await back_up(url.replace("@", ":geheim@"), tmp_path / "copy")
    *arguments, given = (tmp_path / "told").read_text().split()
    assert given == "geheim"
    assert "geheim" not in " ".join(arguments)


def test_each_task_says_which_file_it_needs() -> None:
    with pytest.raises(ValidationError, match="backup needs --to"):
        ExportSettings(task="backup")
    with pytest.raises(ValidationError, match="restore needs --from"):
        ExportSettings(task="restore")
    with pytest.raises(ValidationError, match="backup takes only --to and --history, not --robot"):
        ExportSettings(task="backup", to=Path("copy"), robot="r1")
