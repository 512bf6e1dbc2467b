"""Opens a database, and refuses one whose tables are of another version."""

import asyncio
import sqlite3
import time
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import Final

from sqlalchemy import Connection, inspect, select
from sqlalchemy.exc import OperationalError
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from services.monitor.history.engine import file_of, name_of, private_file, translating
from services.monitor.history.state import HistoryError, OtherVersionError
from services.monitor.history.tables import (
    SCHEMA_VERSION,
    alert_objects,
    clock_correction,
    clock_doubt,
    forgotten,
    metadata,
    object_events,
    open_alerts,
    open_intervals,
    schema_version,
    stock,
    webhook_backlog,
)

OURS: Final = f"this one's are version {SCHEMA_VERSION}"

LATER: Final = frozenset(
    table.name
    for table in (
        schema_version,
        forgotten,
        clock_doubt,
        clock_correction,
        webhook_backlog,
        stock,
        object_events,
        alert_objects,
    )
)
"""Tables that came later, which who reads does without."""

LATER_INDEXES: Final = (open_intervals, open_alerts)

ALONE: Final = 0x666C656575
"""Number of an advisory lock, next to that of the leader: held for a transaction."""

BEGIN_ALONE: Final = {"sqlite": "BEGIN IMMEDIATE", "postgresql": f"SELECT pg_advisory_xact_lock({ALONE})"}

OPEN_TIMEOUT_S: Final = 2.0
"""How long a file may be busy at once, without SQLite's own wait."""

RETRY_S: Final = 0.05


async def connect(engine: AsyncEngine, *, create: bool, complete: bool = False) -> AsyncConnection:
    """Return a connection to a database. create: create missing databases and tables.

    complete: make tables that came later, where the others are.

    Raises:
        OtherVersionError: the tables are those of another version.
        HistoryError: it cannot be had, or is not there and not to be made. The message names the database.
    """
    try:
        async with translating():
            if (file := file_of(engine)) is not None:
                await asyncio.to_thread(private_file if create else _check_there, file)
            connection = await _connected(engine)
        try:
            async with translating():
                await connection.run_sync(_check_tables, create=create, complete=complete)
                await connection.commit()
        except BaseException:
            await connection.close()
            raise
    except HistoryError as error:
        raise type(error)(f"{name_of(engine)}: {error}") from error
    return connection


async def _connected(engine: AsyncEngine) -> AsyncConnection:
    """Connect, once others have that make a WAL database of the same new file: for these SQLite does not wait."""
    began = time.monotonic()
    while True:
        try:
            return await engine.connect()
        except OperationalError as error:
            busy = getattr(error.orig, "sqlite_errorcode", None) == sqlite3.SQLITE_BUSY
            if not busy or time.monotonic() - began > OPEN_TIMEOUT_S:
                raise
            await asyncio.sleep(RETRY_S)


def _check_there(file: Path) -> None:
    if not file.exists():
        raise HistoryError("it does not exist")


def begin_alone(connection: Connection) -> None:
    """Begin a transaction that excludes all others begun like this, in any process."""
    connection.exec_driver_sql(BEGIN_ALONE[connection.dialect.name])


def _check_tables(connection: Connection, *, create: bool, complete: bool) -> None:
    makes = create or complete
    if _are_made(connection) and not (makes and (_missing(connection) or _unindexed(connection))):
        return
    if not create and not _missing(connection) <= LATER:
        raise HistoryError("no monitor has kept anything there")
    if not makes:
        return
    begin_alone(connection)
    are_made = _are_made(connection)  # by another process, meanwhile
    metadata.create_all(connection)
    for index in LATER_INDEXES:
        index.create(connection, checkfirst=True)  # tables may be there without
    if not are_made:
        connection.execute(schema_version.insert().values(id=1, number=SCHEMA_VERSION))


def _missing(connection: Connection) -> AbstractSet[str]:
    return metadata.tables.keys() - set(inspect(connection).get_table_names())


def _unindexed(connection: Connection) -> bool:
    """Whether the tables are there without an index that came later."""
    there = inspect(connection)
    return any(
        not there.has_index(str(index.table), str(index.name)) for index in LATER_INDEXES if index.table is not None
    )


def _are_made(connection: Connection) -> bool:
    """Return whether the tables are those of this version; tables without a version may become so."""
    there = set(inspect(connection).get_table_names())
    number = connection.scalar(select(schema_version.c.number)) if schema_version.name in there else None
    if number is None:
        _check_unnumbered(connection, there)
    elif number != SCHEMA_VERSION:
        age = "newer" if number > SCHEMA_VERSION else "older"
        raise OtherVersionError(f"made by a fleetsight that is {age}: its tables are version {number}, {OURS}")
    return number is not None


def _check_unnumbered(connection: Connection, there: set[str]) -> None:
    """Check the tables of a database from before they had a version."""
    for table in metadata.tables.values():
        if table.name in there:
            columns = {column["name"] for column in inspect(connection).get_columns(table.name)}
            if columns != set(table.columns.keys()):
                older = "made by a fleetsight that is older, or by something else"
                raise OtherVersionError(f"{older}: its table {table.name} has other columns, and no version; {OURS}")
