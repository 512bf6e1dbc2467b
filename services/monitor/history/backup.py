"""`fleetsight history backup` and `restore`: one file that holds a whole history, made while monitors run."""

import asyncio
import os
import shutil
import sqlite3
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from sqlalchemy import Connection, func, inspect, select
from sqlalchemy.ext.asyncio import AsyncEngine

from services.monitor.history.engine import engine_of, file_of, name_of, translating
from services.monitor.history.opening import connect
from services.monitor.history.state import HistoryError
from services.monitor.history.tables import intervals, metadata

LONG_S: Final = 3_600.0

STARTS: Final = {b"SQLite format 3\0": "sqlite", b"PGDMP": "postgresql"}
"""First bytes of a copy, and the database that it was made of."""

CLIENTS: Final = "comes with Debian's package postgresql-client"
LIBPQ: Final = {
    "host": "PGHOST",
    "port": "PGPORT",
    "username": "PGUSER",
    "password": "PGPASSWORD",
    "database": "PGDATABASE",
}
"""Parts of a URL, and libpq's variables for them: a password must not be among a program's arguments."""

LIBPQ_OPTIONS: Final = {"host": "PGHOST", "port": "PGPORT", "ssl": "PGSSLMODE", "sslmode": "PGSSLMODE"}


async def back_up(url: str, to: Path) -> str:
    """Copy a history, as it is at one moment, to a new file that only its owner may read; return a message about it.

    Monitors may write meanwhile. An existing file is replaced once the copy is whole.

    Raises:
        HistoryError: the history cannot be read, or the file not be written.
    """
    engine = engine_of(url)
    try:
        await _count(engine)  # refuses what is no history of this version
        with TemporaryDirectory(dir=to.parent, prefix=".fleetsight-") as folder:
            made = Path(folder) / "backup"
            made.touch(mode=0o600)
            if (file := file_of(engine)) is not None:
                async with translating(LONG_S):
                    await asyncio.to_thread(_copy_sqlite, file, made)
                copy = engine_of(f"sqlite:///{made}")
                count = f"{await _count(copy)} intervals, "
                await copy.dispose()
            else:
                await _run("pg_dump", ["--format=custom", f"--file={made}"], engine)
                count = ""
            size = await asyncio.to_thread(lambda: made.stat().st_size)
            made.replace(to)
    except OSError as error:
        raise HistoryError(f"{to}: {error.strerror}") from error
    finally:
        await engine.dispose()
    return f"{to}: {count}{size / 1e6:.1f} MB"


async def restore(url: str, source: Path) -> str:
    """Make the history that a copy holds, where there is none; return a message about it.

    Raises:
        HistoryError: there is a history, the file is no copy of such a database, or it cannot be written.
    """
    engine = engine_of(url)
    try:
        kind = await asyncio.to_thread(_kind_of, source)
        if kind != engine.dialect.name:
            raise HistoryError(
                f"{source}: it is {f'a copy of {kind}' if kind else 'no backup'}, not of what {name_of(engine)} is"
            )
        if (file := file_of(engine)) is not None:
            await _restore_sqlite(source, file)
        else:
            await _check_empty(engine)
            restoring = ["--no-owner", "--exit-on-error", "--single-transaction", f"--dbname={engine.url.database}"]
            await _run("pg_restore", [*restoring, str(source)], engine)
        return f"{name_of(engine)}: {await _count(engine)} intervals"
    except OSError as error:
        raise HistoryError(f"{error.filename or source}: {error.strerror}") from error
    finally:
        await engine.dispose()


async def _count(engine: AsyncEngine) -> int:
    connection = await connect(engine, create=False)
    try:
        async with translating():
            return await connection.scalar(select(func.count()).select_from(intervals)) or 0
    finally:
        await connection.close()


def _copy_sqlite(source: Path, target: Path) -> None:
    with (
        closing(sqlite3.connect(f"{source.absolute().as_uri()}?mode=rw", uri=True)) as database,
        closing(sqlite3.connect(target)) as copy,
    ):
        database.backup(copy)
        copy.execute("PRAGMA journal_mode=DELETE")
        (said,) = copy.execute("PRAGMA integrity_check(1)").fetchone()
    if said != "ok":
        raise HistoryError(f"{source}: SQLite finds it damaged: {said}")


async def _restore_sqlite(source: Path, file: Path) -> None:
    there = [path for path in (file, Path(f"{file}-wal"), Path(f"{file}-shm")) if path.exists()]
    if there:
        raise HistoryError(f"{there[0]} is there: stop the monitor and move {file}* aside first")
    file.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=file.parent, prefix=".fleetsight-") as folder:
        made = Path(folder) / "history.db"
        made.touch(mode=0o600)
        async with translating(LONG_S):
            await asyncio.to_thread(_copy_sqlite, source, made)
        copy = engine_of(f"sqlite:///{made}")
        await _count(copy)
        await copy.dispose()
        os.link(made, file)  # unlike a rename, it replaces nothing


async def _check_empty(engine: AsyncEngine) -> None:
    def ours(connection: Connection) -> set[str]:
        return metadata.tables.keys() & set(inspect(connection).get_table_names())

    async with translating(), engine.connect() as connection:
        if await connection.run_sync(ours):
            raise HistoryError(f"{name_of(engine)}: there is a history: restore into an empty database")


def _kind_of(file: Path) -> str:
    with file.open("rb") as opened:
        start = opened.read(max(map(len, STARTS)))
    return next((kind for first, kind in STARTS.items() if start.startswith(first)), "")


def _variables(engine: AsyncEngine) -> Mapping[str, str]:
    """Return libpq's environment for a database."""
    url = engine.url
    parts = {variable: str(value) for name, variable in LIBPQ.items() if (value := getattr(url, name)) is not None}
    options = {LIBPQ_OPTIONS[name]: str(value) for name, value in url.query.items() if name in LIBPQ_OPTIONS}
    return {**os.environ, **parts, **options}


async def _run(program: str, arguments: list[str], engine: AsyncEngine) -> None:
    if shutil.which(program) is None:
        raise HistoryError(f"{program} is not installed: it {CLIENTS}")
    process = await asyncio.create_subprocess_exec(
        program,
        *arguments,
        "--no-password",
        env=_variables(engine),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        _, said = await process.communicate()
    except asyncio.CancelledError:
        process.kill()
        await process.wait()
        raise
    if process.returncode:
        raise HistoryError(f"{name_of(engine)}: {' '.join(said.decode(errors='replace').split())[:300]}")
