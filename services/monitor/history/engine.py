"""Connections to the history's database, and its errors in one line."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final

from sqlalchemy import event
from sqlalchemy.engine import make_url
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine
from sqlalchemy.pool import NullPool

from services.monitor.history.errors import HistoryError

DRIVERS: Final = {"sqlite": "sqlite+aiosqlite", "postgresql": "postgresql+asyncpg"}
TIMEOUT_S: Final = 10.0
"""How long the database may take for one thing."""

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
        event.listen(engine.sync_engine, "connect", _set_pragmas)
    return engine


def file_of(engine: AsyncEngine) -> Path | None:
    """Return the file of an SQLite database."""
    return Path(engine.url.database or "") if engine.dialect.name == "sqlite" else None


@asynccontextmanager
async def translating(timeout_s: float = TIMEOUT_S) -> AsyncIterator[None]:
    """Make one HistoryError of whatever a database does, or does not do in time."""
    try:
        async with asyncio.timeout(timeout_s):
            yield
    except TimeoutError as error:
        raise HistoryError(f"the database did not answer within {timeout_s:g} s") from error
    except Exception as error:  # drivers raise errors of their own beside SQLAlchemy's, and rows may be anybody's
        cause = getattr(error, "orig", None) or error
        raise HistoryError(" ".join(str(cause).split())[:300] or type(cause).__name__) from error


def _set_pragmas(connection: Any, _: object) -> None:
    cursor = connection.cursor()
    for pragma in PRAGMAS:
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()
