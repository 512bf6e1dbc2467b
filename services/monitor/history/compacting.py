"""Making the file of an SQLite database as small as what is in it."""

import asyncio
from typing import Final

from services.monitor.history.engine import engine_of, file_of, name_of, translating
from services.monitor.history.errors import HistoryError
from services.monitor.history.opening import connect

LONG_S: Final = 3_600.0


async def compact(url: str) -> str:
    """Write an SQLite file anew, so that it shrinks by itself from then on; return in words what was done.

    A file that an earlier release made does so only after this. It takes as much free disk as the file has, and a
    monitor that runs keeps no history meanwhile: what changes waits.

    Raises:
        HistoryError: it is no SQLite file, or cannot be written.
    """
    engine = engine_of(url)
    file = file_of(engine)
    if file is None:
        raise HistoryError(f"{name_of(engine)}: only a file of SQLite's is compacted; PostgreSQL looks after its own")
    connection = await connect(engine, create=False)
    try:
        before = await asyncio.to_thread(lambda: file.stat().st_size)
        async with translating(LONG_S):
            for statement in ("PRAGMA auto_vacuum=INCREMENTAL", "VACUUM", "PRAGMA wal_checkpoint(TRUNCATE)"):
                await connection.exec_driver_sql(statement)
    finally:
        await connection.close()
        await engine.dispose()
    after = await asyncio.to_thread(lambda: file.stat().st_size)
    return f"{file}: {before / 1e6:.1f} MB, {after / 1e6:.1f} MB after"
