"""Connections to the history's database, and its errors in one line."""

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final

from sqlalchemy import event
from sqlalchemy.engine import make_url
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine
from sqlalchemy.pool import NullPool

from services.monitor.history.errors import HistoryError

DRIVERS: Final = {"sqlite": "sqlite+aiosqlite", "postgresql": "postgresql+asyncpg"}
CASEFOLD: Final = "fleet_casefold"
"""A function of SQLite's that knows all letters: its own `lower` knows those of ASCII."""

TIMEOUT_S: Final = 10.0
"""How long the database may take for one thing."""

SHRINKS: Final = "auto_vacuum=INCREMENTAL"
"""How a new file is made, of which nothing is written yet."""

PRAGMAS: Final = ("journal_mode=WAL", "synchronous=NORMAL", "busy_timeout=5000")


def engine_of(url: str) -> AsyncEngine:
    """Return an engine that connects when it is first used.

    Raises:
        HistoryError: it is no URL of a database.
    """
    try:
        parsed = make_url(url)
        engine = create_async_engine(parsed.set(drivername=DRIVERS[parsed.drivername]), poolclass=NullPool)
    except (SQLAlchemyError, KeyError, ValueError) as error:
        raise HistoryError(f"not the URL of a database: {error}") from error
    if engine.dialect.name == "sqlite":
        event.listen(engine.sync_engine, "do_connect", _make_no_file)
        event.listen(engine.sync_engine, "connect", _set_pragmas)
    return engine


def file_of(engine: AsyncEngine) -> Path | None:
    """Return the file of an SQLite database."""
    return Path(engine.url.database or "") if engine.dialect.name == "sqlite" else None


def name_of(engine: AsyncEngine) -> str:
    """Return what to call a database in words: its file, or its URL without what may be secret."""
    if (file := file_of(engine)) is not None:
        return str(file)
    url = engine.url.set(drivername=engine.url.get_backend_name())
    return url.difference_update_query(url.query).render_as_string(hide_password=True)


def private_file(file: Path) -> None:
    """Make the file of an SQLite database where there is none; nobody else may read it: it holds passwords' hashes.

    One that is there is not opened: closing it again would undo the locks of whoever uses it in this process. A link
    counts as the file that it leads to, and is no file itself.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with suppress(FileExistsError):
        os.close(os.open(os.path.realpath(file), os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))


@asynccontextmanager
async def translating(timeout_s: float = TIMEOUT_S) -> AsyncIterator[None]:
    """Make one HistoryError of whatever a database does, or does not do in time."""
    try:
        async with asyncio.timeout(timeout_s):
            yield
    except TimeoutError as error:
        raise HistoryError(f"the database did not answer within {timeout_s:g} s") from error
    except HistoryError:
        raise
    except Exception as error:  # drivers raise errors of their own beside SQLAlchemy's, and rows may be anybody's
        cause = getattr(error, "orig", None) or error
        raise HistoryError(" ".join(str(cause).split())[:300] or type(cause).__name__) from error


def _make_no_file(_dialect: Any, _record: Any, where: list[Any], how: dict[str, Any]) -> None:
    """Have SQLite open a file that is there, and not make one that is moved at that very moment.

    It would be empty, anybody's to read, and SQLite would delete the `-wal` that it finds beside an empty file.
    """
    file = Path(where[0])
    if not how.get("uri") and file.is_absolute():  # SQLAlchemy makes a file's name so; one in memory has none
        where[0], how["uri"] = f"{file.as_uri()}?mode=rw", True


def _set_pragmas(connection: Any, _: object) -> None:
    cursor = connection.cursor()
    cursor.execute("PRAGMA page_count")
    is_new = cursor.fetchone()[0] == 0
    for pragma in (*([SHRINKS] if is_new else []), *PRAGMAS):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()
    connection.create_function(CASEFOLD, 1, str.casefold, deterministic=True)
