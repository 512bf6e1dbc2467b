"""Models that failed here: why, and when each is tried again. One that ends the process is known at the next start."""

import fcntl
import logging
import math
import os
import random
import secrets
import time
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

log = logging.getLogger(__name__)

RETRY_S: Final = (60.0, 1800.0)
"""Seconds until a model that failed is tried again: the first time, and at most."""

BLIND_RETRY_S: Final = (5.0, 300.0)
"""The same while no other model runs."""

MARK: Final = ".trying-"
ENDED: Final = "the detector ended while it loaded it, or before its first image"


def growing_wait_s(tries: int, first_s: float, most_s: float) -> float:
    """Return how long to wait after the last of so many failures; by lot, as hundreds of workers may wait."""
    return _grown(tries, first_s, most_s) * _lot()


def _grown(tries: int, first_s: float, most_s: float) -> float:
    return min(most_s, first_s * 2.0 ** min(tries - 1, 32))


def _lot() -> float:
    return random.uniform(0.75, 1.25)  # noqa: S311 - no secret


@dataclass(frozen=True, slots=True)
class _Refusal:
    why: str
    tries: int
    since_s: float
    lot: float = field(default_factory=_lot)

    def until_s(self, *, blind: bool) -> float:
        return self.since_s + self.lot * _grown(self.tries, *(BLIND_RETRY_S if blind else RETRY_S))


class Refusals:
    """Knows models by their digests. folder: for the marks of models that are tried; workers may share it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._own = secrets.token_hex(4)
        self._refused: dict[str, _Refusal] = {}
        self._marks: dict[str, int] = {}

    def recall(self) -> None:
        """Refuse models whose marks stayed: the process that tried them has ended. Of a model's marks one is kept."""
        now_s = time.time()
        kept: dict[str, Path] = {}
        for file, digest in self._files():
            with suppress(OSError, ValueError), file.open("rb") as mark:
                fcntl.flock(mark, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails while that process lives
                tries = int(mark.read(20))
                ago_s = max(0.0, now_s - os.fstat(mark.fileno()).st_mtime)
                known = self._refused.get(digest)
                if known is not None and known.tries > tries:
                    file.unlink()
                    continue
                self._refused[digest] = _Refusal(ENDED, tries, time.monotonic() - ago_s)
                if digest in kept:
                    kept[digest].unlink(missing_ok=True)
                kept[digest] = file

    def why(self, digest: str, *, blind: bool) -> str | None:
        """Return why a model is not tried now; None if it may be tried. blind: whether no other model runs."""
        refusal = self._refused.get(digest)
        return None if refusal is None or refusal.until_s(blind=blind) <= time.monotonic() else refusal.why

    def wait_s(self, digests: Collection[str], *, blind: bool) -> float:
        """Return how long it is until the first of some models is to be tried again; infinite if none is refused."""
        ends = (each.until_s(blind=blind) for digest, each in self._refused.items() if digest in digests)
        return max(0.0, min(ends, default=math.inf) - time.monotonic())

    def refuse(self, digest: str, why: str) -> None:
        """Refuse a model for a time, which grows with each failure."""
        self._unmark(digest)
        self._refused[digest] = _Refusal(why, self._tries(digest) + 1, time.monotonic())

    def trying(self, digest: str) -> None:
        """Mark a model as tried until it works, is refused, or the process ends well."""
        if digest in self._marks:
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            mark = os.open(self._folder / f"{MARK}{digest}-{self._own}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
            self._marks[digest] = mark
            fcntl.flock(mark, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.write(mark, str(self._tries(digest) + 1).encode())
        except OSError as error:
            log.warning("%s: %s: if this model ends the process, it will be tried again", self._folder, error.strerror)

    def works(self, digest: str) -> None:
        """A model has found objects: forget that it failed, here and in processes that have ended."""
        if digest in self._marks or digest in self._refused:
            self._unmark(digest)
            self._forget(digest)

    def leave_marked(self, digest: str) -> None:
        """Keep a model's mark: it is about to end the process."""
        if digest in self._marks:
            os.close(self._marks.pop(digest))

    def forget_all_but(self, digests: Collection[str]) -> None:
        """Forget failures of all other models."""
        for digest in [each for each in self._refused if each not in digests]:
            self._forget(digest)

    def close(self) -> None:
        """Remove this process's marks: it ends well."""
        for digest in list(self._marks):
            self._unmark(digest)

    def _tries(self, digest: str) -> int:
        return self._refused[digest].tries if digest in self._refused else 0

    def _unmark(self, digest: str) -> None:
        if digest in self._marks:
            with suppress(OSError):
                (self._folder / f"{MARK}{digest}-{self._own}").unlink()
            os.close(self._marks.pop(digest))

    def _forget(self, digest: str) -> None:
        """Forget a model's failures, and remove marks of processes that have ended."""
        self._refused.pop(digest, None)
        for file, marked in self._files():
            if marked == digest:
                with suppress(OSError), file.open("rb") as mark:
                    fcntl.flock(mark, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    file.unlink()

    def _files(self) -> Iterator[tuple[Path, str]]:
        with suppress(OSError):
            for file in list(self._folder.glob(f"{MARK}*")):
                yield file, file.name.removeprefix(MARK).partition("-")[0]
