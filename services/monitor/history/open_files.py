"""The files of an open SQLite database. SQLite goes on in them, and says nothing, when they are moved or deleted."""

import os
from pathlib import Path
from typing import Final

from services.monitor.history.errors import HistoryError

BESIDE: Final = ("-wal", "-shm")
"""As bad where they alone are deleted: whoever opens the database next has others, and they write past each other."""

Identity = tuple[int, int]


class OpenFiles:
    """Which files a database has: made before it is opened, told when it is.

    file: a link counts as the file that it leads to.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self._known: dict[Path, Identity] = {}
        self._note(file)

    def opened(self) -> None:
        """Take what is there for what was opened; raises HistoryError if it was moved meanwhile."""
        real = os.path.realpath(self.file)  # SQLite has them there
        for path in (self.file, *(Path(real + suffix) for suffix in BESIDE)):
            if path not in self._known:
                self._note(path)
        if self.file not in self._known:
            raise HistoryError(f"{self.file}: it does not exist")
        self.check()

    def locked(self, lock: Path, descriptor: int) -> None:
        """Count a file that has our lock among them."""
        self._known[lock] = _identity(os.fstat(descriptor))

    def check(self) -> None:
        """Raise HistoryError if one of them was moved, deleted or replaced."""
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
