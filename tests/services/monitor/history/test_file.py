"""An SQLite history as files: readers wait for no writer, and what is closed is one file."""

import sqlite3
from contextlib import closing
from pathlib import Path

from tests.services.monitor.history.test_store import interval, opened
from tests.services.monitor.inventory.seeing import S


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
