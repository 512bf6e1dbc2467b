"""Debian's real PostgreSQL server, for as long as a test needs one."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from services.toolbox.demo.children import free_ports
from tests.missing import require_debian

ROOT: Final = Path("/usr/lib/postgresql")
USER: Final = "postgres"
PATIENCE_S: Final = 60


class PostgreSQL:
    """A server with a data directory of its own, on loopback, that trusts everybody."""

    def __init__(self, programs: Path, folder: Path) -> None:
        self._programs = programs
        self._folder = folder
        self._user = USER if os.geteuid() == 0 else None  # it refuses to run as root
        self.port = free_ports(1)
        self._run("initdb", "--no-sync", "--auth=trust", f"--username={USER}", "--encoding=UTF8", "--locale=C")

    def url(self, database: str = "postgres") -> str:
        """Return where a database is."""
        return f"postgresql://{USER}@127.0.0.1:{self.port}/{database}"

    def create(self, database: str) -> str:
        """Make an empty database and return where it is."""
        where = ("--host=127.0.0.1", f"--port={self.port}", f"--username={USER}")
        subprocess.run([self._programs / "createdb", *where, database], check=True, timeout=PATIENCE_S)
        return self.url(database)

    def start(self) -> None:
        """Start it and wait until it answers."""
        options = (f"-p {self.port} -c listen_addresses=127.0.0.1 -c unix_socket_directories='' -c fsync=off",)
        self._run("pg_ctl", "-w", "-l", str(self._folder / "log"), "-o", *options, "start")

    def stop(self) -> None:
        """Stop it at once, whoever is connected."""
        self._run("pg_ctl", "-w", "-m", "immediate", "stop")

    def _run(self, program: str, *arguments: str) -> None:
        subprocess.run(
            [self._programs / program, f"--pgdata={self._folder / 'data'}", *arguments],
            check=True,
            stdout=subprocess.DEVNULL,
            timeout=PATIENCE_S,
            user=self._user,
        )


@contextmanager
def running_postgresql() -> Iterator[PostgreSQL]:
    """Run a server; skip, or fail in CI, where there is none."""
    found = sorted(ROOT.glob("*/bin/postgres")) or [ROOT / "bin" / "postgres"]
    require_debian("PostgreSQL", found, how="tests/install/postgresql.sh installs it")
    folder = Path(tempfile.mkdtemp(prefix="fleetsight-postgresql-"))
    if os.geteuid() == 0:
        shutil.chown(folder, USER)
    try:
        server = PostgreSQL(found[-1].parent, folder)
        server.start()
        try:
            yield server
        finally:
            server.stop()
    finally:
        shutil.rmtree(folder)
