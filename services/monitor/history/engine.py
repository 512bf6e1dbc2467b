"""Connections to the history's database, and its errors as one line each."""

import asyncio
import os
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final

from sqlalchemy import event, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine
from sqlalchemy.pool import NullPool

from services.monitor.history.state import HistoryError

DRIVERS: Final = {"sqlite": "sqlite+aiosqlite", "postgresql": "postgresql+asyncpg"}
CASEFOLD: Final = "fleet_casefold"
"""A function of SQLite's that knows all letters: its own `lower` knows those of ASCII."""

TIMEOUT_S: Final = 10.0
"""How long the database may take for one thing."""

SHRINKS: Final = "auto_vacuum=INCREMENTAL"
"""How a new file is made, of which nothing is written yet."""

PRAGMAS: Final = ("journal_mode=WAL", "synchronous=NORMAL", "busy_timeout=5000")


def engine_of(url: str) -> AsyncEngine:
    """Return an engine that connects on first use.

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
    """Return a printable name of a database: its file, or its URL without secrets."""
    if (file := file_of(engine)) is not None:
        return str(file)
    url = engine.url.set(drivername=engine.url.get_backend_name())
    return url.difference_update_query(url.query).render_as_string(hide_password=True)


def private_file(file: Path) -> None:
    """Create a missing SQLite file that only its owner may read: it holds password hashes.

    One that is there is not opened: closing it again would release the locks of other users in this process. A link
    counts as the file that it leads to, and is no file itself.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with suppress(FileExistsError):
        os.close(os.open(os.path.realpath(file), os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))


@asynccontextmanager
async def translating(timeout_s: float = TIMEOUT_S) -> AsyncIterator[None]:
    """Turn any database error or timeout into one HistoryError."""
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


MAX_NAME: Final = 63
"""Letters of an application's name in PostgreSQL."""

TELL_NAME: Final = text("SELECT set_config('application_name', :name, false)")

LEADER: Final = text(
    "SELECT application_name FROM pg_locks JOIN pg_stat_activity USING (pid) WHERE locktype = 'advisory' AND granted"
    " AND objsubid = 1 AND classid::bigint << 32 | objid::bigint = :lock AND pg_locks.database ="
    " (SELECT oid FROM pg_database WHERE datname = current_database())"
)


def own_name() -> str:
    """Return the name of this process as shown to others."""
    return f"{socket.gethostname()[: MAX_NAME - 20]}, process {os.getpid()}"


def lock_of(file: Path) -> Path:
    """Return the lock file beside an SQLite database, which the leader locks and writes its name into."""
    return Path(f"{file}-lock")


def read_name(lock: Path) -> str:
    """Return the name in a lock file; empty if there is none."""
    with suppress(OSError):
        return lock.read_bytes()[:MAX_NAME].decode(errors="replace")
    return ""


BESIDE: Final = ("-wal", "-shm")
"""As bad where they alone are deleted: the next process to open the database makes others, and the two write past each
other."""

Identity = tuple[int, int]


class OpenFiles:
    """The files of a database: created before it is opened, recorded once it is.

    file: a link counts as the file that it leads to.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self._known: dict[Path, Identity] = {}
        self._note(file)

    def opened(self) -> None:
        """Record the present files as opened; raises HistoryError if one was moved meanwhile."""
        real = os.path.realpath(self.file)  # SQLite has them there
        for path in (self.file, *(Path(real + suffix) for suffix in BESIDE)):
            if path not in self._known:
                self._note(path)
        if self.file not in self._known:
            raise HistoryError(f"{self.file}: it does not exist")
        self.check()

    def locked(self, lock: Path, descriptor: int) -> None:
        """Add the file of our lock."""
        self._known[lock] = _identity(os.fstat(descriptor))

    def check(self) -> None:
        """Raise HistoryError if one of the files was moved, deleted or replaced."""
        for path, known in list(self._known.items()):
            found = _found(path)
            if found is None:
                raise HistoryError(f"{path}: it does not exist")
            if found != known:
                raise HistoryError(f"{path}: another file is there than was opened")

    def _note(self, path: Path) -> None:
        if (found := _found(path)) is not None:
            self._known[path] = found


def _found(path: Path) -> Identity | None:
    try:
        return _identity(path.stat())
    except (FileNotFoundError, NotADirectoryError):
        return None


def _identity(of: os.stat_result) -> Identity:
    return of.st_dev, of.st_ino
