"""Notices changes of the files that a session was opened with."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

LOOKED_AT_S: Final = 10.0
"""Interval between two looks at the files."""

Stamp = tuple[int, int, int, int]


class ChangedFiles:
    """Certificates, keys and access rules of a session; a change counts once it is the same at two looks."""

    def __init__(self, files: Sequence[Path | None]) -> None:
        self._files = [file for file in files if file is not None]
        self._used = self._looked = self._stamps()

    def __bool__(self) -> bool:
        """Whether there are any files."""
        return bool(self._files)

    def use(self) -> None:
        """Note that the files are used, or given up, as they are now."""
        self._used = self._looked = self._stamps()

    def changed(self) -> bool:
        """Look; return whether the files are others than those in use, and nobody writes them any more."""
        before, self._looked = self._looked, self._stamps()
        return before == self._looked != self._used

    def _stamps(self) -> list[Stamp | None]:
        return [_stamp(file) for file in self._files]


def _stamp(file: Path) -> Stamp | None:
    try:
        found = file.stat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns  # the last also where a right changes
