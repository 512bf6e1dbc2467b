"""Notices that a file has another version, once it is written whole."""

from pathlib import Path

_Stamp = tuple[int, int, int]


class FileVersion:
    """The version of a file that was read last, by its time, size and inode."""

    def __init__(self) -> None:
        self._seen: _Stamp | None = None
        self._read: _Stamp | None = None

    def is_new(self, path: Path, *, settled: bool) -> bool:
        """Return whether a version is to be read that was not read yet; the caller reads it.

        settled: only one that was there at the last look, too: a newer one may be half written.

        Raises:
            OSError: the file is not there or may not be looked at.
        """
        stamp = _stamp_of(path)
        before, self._seen = self._seen, stamp
        if stamp == self._read or (settled and stamp != before):
            return False
        self._read = stamp
        return True

    def take(self, path: Path) -> None:
        """Take a version as read.

        Raises:
            OSError: the file is not there or may not be looked at.
        """
        self._seen = self._read = _stamp_of(path)

    def forget(self) -> None:
        """Read whatever is there next time: the last version could not be used, or was not there."""
        self._seen = self._read = None


def _stamp_of(path: Path) -> _Stamp:
    found = path.stat()
    return found.st_mtime_ns, found.st_size, found.st_ino
