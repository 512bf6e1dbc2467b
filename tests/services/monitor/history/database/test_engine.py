"""Connections to the database."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy.engine import URL
from sqlalchemy.exc import OperationalError

from services.monitor.history.engine import engine_of, file_of, name_of, private_file
from services.monitor.history.state import HistoryError
from tests.services.monitor.history.test_store import interval, opened
from tests.services.monitor.inventory.seeing import S


def test_a_new_database_is_nobody_elses_to_read_and_one_that_is_there_stays_as_it_is(tmp_path: Path) -> None:
    file = tmp_path / "new" / "history.db"
    private_file(file)
    assert (file.stat().st_mode & 0o777, file.read_bytes()) == (0o600, b"")
    file.write_bytes(b"kept")
    file.chmod(0o640)
    private_file(file)
    assert (file.stat().st_mode & 0o777, file.read_bytes()) == (0o640, b"kept")


def test_a_link_to_a_file_that_is_not_there_yet_makes_it_nobody_elses_to_read(tmp_path: Path) -> None:
    link, file = tmp_path / "link.db", tmp_path / "history.db"
    link.symlink_to(file)
    private_file(link)
    assert (link.is_symlink(), file.stat().st_mode & 0o777) == (True, 0o600)


@pytest.mark.parametrize("name", ["history.db", "50% of ö ?#&.db"])
async def test_sqlite_makes_no_file_of_its_own(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    engine = engine_of(URL.create("sqlite", database=str(file)).render_as_string())
    with pytest.raises(OperationalError, match="unable to open"):
        async with engine.connect():
            pass
    assert not file.exists()
    private_file(file)
    async with engine.connect() as connection:
        await connection.exec_driver_sql("CREATE TABLE any (id INTEGER)")
    assert file.stat().st_size > 0


def test_only_sqlite_has_a_file(tmp_path: Path) -> None:
    assert file_of(engine_of(f"sqlite:///{tmp_path}/history.db")) == tmp_path / "history.db"
    assert file_of(engine_of("postgresql://ann@127.0.0.1:1/fleet")) is None


@pytest.mark.parametrize(
    ("url", "name"),
    [
        ("sqlite:////var/lib/fleetsight/history.db", "/var/lib/fleetsight/history.db"),
        ("postgresql://ann:secret@db:5433/fleet?password=secret", "postgresql://ann:***@db:5433/fleet"),
        ("postgresql://db/fleet", "postgresql://db/fleet"),
    ],
)
def test_a_database_is_called_by_its_place_alone(url: str, name: str) -> None:
    assert name_of(engine_of(url)) == name


@pytest.mark.parametrize("url", ["", "no url", "mysql://127.0.0.1/fleet"])
def test_what_is_no_url_of_a_database_is_said(url: str) -> None:
    with pytest.raises(HistoryError, match="not the URL of a database"):
        engine_of(url)


def names(folder: Path) -> list[str]:
    return [each.name for each in folder.iterdir()]


async def test_while_it_is_written_others_may_read_and_in_the_end_it_is_one_file(tmp_path: Path) -> None:
    file = tmp_path / "history.db"
    async with opened(f"sqlite:///{file}") as store:
        await store.write([interval(1, 2)], [], 2 * S)
        with closing(sqlite3.connect(file)) as reader:
            assert reader.execute("PRAGMA journal_mode").fetchone() == ("wal",)
            reader.execute("BEGIN")
            assert reader.execute("SELECT count(*) FROM intervals").fetchone() == (1,)
            await store.write([interval(3, 4)], [], 4 * S)
            assert reader.execute("SELECT count(*) FROM intervals").fetchone() == (1,)
    assert names(tmp_path) == ["history.db"]
