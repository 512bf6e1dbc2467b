"""Who leads, of several monitors with one database: what it calls itself, and where others read that."""

import os
import socket
from contextlib import suppress
from pathlib import Path
from typing import Final

from sqlalchemy import text

MAX_NAME: Final = 63
"""Letters of an application's name in PostgreSQL."""

TELL_NAME: Final = text("SELECT set_config('application_name', :name, false)")

LEADER: Final = text(
    "SELECT application_name FROM pg_locks JOIN pg_stat_activity USING (pid) WHERE locktype = 'advisory' AND granted"
    " AND objsubid = 1 AND classid::bigint << 32 | objid::bigint = :lock AND pg_locks.database ="
    " (SELECT oid FROM pg_database WHERE datname = current_database())"
)


def own_name() -> str:
    """Return what others call this process."""
    return f"{socket.gethostname()[: MAX_NAME - 20]}, process {os.getpid()}"


def lock_of(file: Path) -> Path:
    """Return the file beside an SQLite database that whoever leads has locked, and wrote its name into."""
    return Path(f"{file}-lock")


def read_name(lock: Path) -> str:
    """Return the name in such a file; empty where there is none."""
    with suppress(OSError):
        return lock.read_bytes()[:MAX_NAME].decode(errors="replace")
    return ""
