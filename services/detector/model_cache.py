"""Published models on this machine: files whose digests are checked, and which of them were run last."""

import asyncio
import logging
import tempfile
import time
from collections.abc import Awaitable, Callable, Collection
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from schemas.models import ModelRegistry, PublishedModel
from services.detector.runtime.exporting import MAKING, remove_abandoned
from services.model_registry.registry import digest_of
from services.whole_file import write_whole

log = logging.getLogger(__name__)

LAST: Final = "last.json"


class DamagedModelError(Exception):
    """A file is not the one that was published."""


class ModelCache:
    """The folder `models` in a worker's cache; workers of one machine may share it."""

    def __init__(self, cache: Path) -> None:
        self.folder = cache / "models"

    def path(self, model: PublishedModel) -> Path:
        """Return where a model's file is; its name is what the model is called in results."""
        return self.folder / f"{model.label}.pt"

    def holds(self, model: PublishedModel) -> bool:
        """Whether the model's file is here and whole; a damaged one is removed. Reads the file."""
        file = self.path(model)
        try:
            if not file.exists():
                return False
            if file.stat().st_size == model.size and digest_of(file) == model.digest:
                return True
            log.warning("%s is damaged, and fetched again", file)
            file.unlink(missing_ok=True)
        except OSError as error:
            log.warning("%s cannot be read: %s", file, error.strerror)
        return False

    async def fill(self, model: PublishedModel, fetch: Callable[[Path], Awaitable[None]]) -> None:
        """Have a model's file fetched to a path of its own, and keep it once it is whole.

        Raises:
            DamagedModelError: the file that came has another digest.
            OSError: the cache cannot be written. What `fetch` raises.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        remove_abandoned(self.folder, time.time())
        with tempfile.TemporaryDirectory(prefix=MAKING, dir=self.folder, ignore_cleanup_errors=True) as folder:
            file = Path(folder) / "model.part"
            await fetch(file)
            if await asyncio.to_thread(digest_of, file) != model.digest:
                raise DamagedModelError(f"what came of {model.label} has another digest than what was published")
            file.replace(self.path(model))

    def remember(self, state: ModelRegistry) -> None:
        """Note what is run now, for a start without a monitor; and remove files that the registry no longer has.

        state: all models of the registry, and those in force here.
        """
        try:
            write_whole(self.folder / LAST, msgspec.json.format(msgspec.json.encode(state)))
            self._remove_all_but({self.path(each) for each in state.models})
        except OSError as error:
            log.warning(
                "a start without a monitor will not know this model: --cache %s: %s", self.folder, error.strerror
            )

    def recall(self) -> ModelRegistry | None:
        """Return what was run last; None if nothing was, or it cannot be read."""
        with suppress(OSError, msgspec.MsgspecError, UnicodeError):
            return msgspec.json.decode((self.folder / LAST).read_bytes(), type=ModelRegistry)
        return None

    def _remove_all_but(self, known: Collection[Path]) -> None:
        for file in self.folder.glob("*@*.pt"):
            if file not in known:
                file.unlink(missing_ok=True)
