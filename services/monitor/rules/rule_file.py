"""The rule file: reloaded on change; a mistake leaves the rules in force."""

import asyncio
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from services.monitor.file_version import FileVersion
from services.monitor.rules.loading import MAX_CHARACTERS, RuleFileError, load_rules
from services.monitor.rules.model import RuleBook

log = logging.getLogger(__name__)

LOOK_S: Final = 0.5


@contextmanager
def _reading() -> Iterator[None]:
    """Turn errors of reading a file into RuleFileError."""
    try:
        yield
    except (OSError, UnicodeDecodeError) as error:
        raise RuleFileError(None, getattr(error, "strerror", None) or str(error)) from error


def text_of(path: Path) -> str:
    """Return the text of a rule file; of one that is too long, enough for `load_rules` to refuse it.

    Raises:
        RuleFileError: it cannot be read.
    """
    with _reading(), path.open(encoding="utf-8") as file:
        return file.read(MAX_CHARACTERS + 1)


class RuleFile:
    """The rules of a file. problem: why the newest version is not in force, in words, or empty."""

    def __init__(self, path: Path | None) -> None:
        self.book = RuleBook()
        self.problem = ""
        self._path = path
        self._version = FileVersion()

    async def load(self) -> None:
        """Read the file for the first time.

        Raises:
            RuleFileError: it cannot be used.
        """
        if self._path is None:
            return
        try:
            await asyncio.to_thread(self._read, self._path, settled=False)
        except RuleFileError as error:
            raise error.of(self._path) from error

    async def watch(self) -> None:
        """Keep `book` up to date until cancelled."""
        while self._path is not None:
            await asyncio.sleep(LOOK_S)
            await self.look(self._path)

    async def look(self, path: Path) -> None:
        """Reload the file if it changed and then stayed the same for one check: it may be half written."""
        try:
            await asyncio.to_thread(self._read, path, settled=True)
        except RuleFileError as error:
            problem = f"{path}: {error}; the rules stay as they were"
            if problem != self.problem:
                log.error("%s", problem)  # noqa: TRY400 - it is no fault of ours
            self.problem = problem

    def _read(self, path: Path, *, settled: bool) -> None:
        try:
            with _reading():
                is_new = self._version.is_new(path, settled=settled)
            if not is_new:
                return
            text = text_of(path)
        except RuleFileError:
            self._version.forget()
            raise
        self.book = load_rules(text)
        self.problem = ""
        log.info("%s: %d rules are in force", path, len(self.book.rules))
