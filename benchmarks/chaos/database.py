"""PostgreSQL as a process that can be killed, on a disk that can be filled."""

import os
import shutil
import subprocess
from pathlib import Path
from typing import Final

from services.toolbox.demo.children import free_ports

ROOT: Final = Path("/usr/lib/postgresql")
USER: Final = "postgres"
FILLING: Final = "filling"
LIMIT_S: Final = 60


def programs() -> Path | None:
    """Return where PostgreSQL's programs are; None where there are none."""
    found = sorted(ROOT.glob("*/bin/postgres"))
    return found[-1].parent if found else None


class Database:
    """A server with a data directory in a folder, on loopback, that trusts everybody. It is durable: fsync is on."""

    def __init__(self, folder: Path) -> None:
        there = programs()
        if there is None:
            raise FileNotFoundError(f"no PostgreSQL below {ROOT}")
        self._programs = there
        self._folder = folder
        self._as_root = os.geteuid() == 0  # it refuses to run as root
        self.port = free_ports(1)
        self.url = f"postgresql://{USER}@127.0.0.1:{self.port}/{USER}"
        if self._as_root:
            shutil.chown(folder, USER, USER)
        options = ("--auth=trust", f"--username={USER}", "--encoding=UTF8", "--locale=C", "--no-sync")
        subprocess.run(
            [str(there / "initdb"), f"--pgdata={folder / 'data'}", *options],
            check=True,
            stdout=subprocess.DEVNULL,
            timeout=LIMIT_S,
            user=USER if self._as_root else None,
        )

    def command(self) -> list[str]:
        """Return the server's command line."""
        user = ["setpriv", f"--reuid={USER}", f"--regid={USER}", "--clear-groups"] if self._as_root else []
        options = ("listen_addresses=127.0.0.1", "unix_socket_directories=", "max_wal_size=64MB", "min_wal_size=32MB")
        server = [str(self._programs / "postgres"), "-D", str(self._folder / "data"), "-p", str(self.port)]
        return [*user, *server, *(part for option in options for part in ("-c", option))]

    def answers(self) -> bool:
        """Whether it takes connections."""
        ready = [str(self._programs / "pg_isready"), "-q", "-h", "127.0.0.1", "-p", str(self.port), "-t", "1"]
        return subprocess.run(ready, check=False).returncode == 0


def fill(folder: Path) -> None:
    """Write until the disk that a folder is on is full."""
    with (folder / FILLING).open("wb", buffering=0) as file:
        for size in (1 << 20, 1 << 12, 1 << 9):
            try:
                while file.write(bytes(size)) == size:
                    pass
            except OSError:
                continue


def make_room(folder: Path) -> None:
    """Undo `fill`."""
    (folder / FILLING).unlink()
