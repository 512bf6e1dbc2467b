"""Published models on this machine: files whose digests are checked, and which of them were run last."""

import asyncio
import logging
import secrets
import tempfile
import time
from collections.abc import Awaitable, Callable, Collection
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from schemas.models import ModelRegistry, PublishedModel
from services.model_registry.registry import digest_of
from services.whole_file import FOLDER_MODE, NotOursError, check_ours, keep_others_out

log = logging.getLogger(__name__)

LAST: Final = "last.json"
PART: Final = ".part"
SUFFIXES: Final = (".pt", ".onnx")
UNUSED_S: Final = 24 * 3600
"""Age at which a file is no longer one that another worker of the machine fetches or loads."""


class DamagedModelError(Exception):
    """A file is not the one that was published."""


def usable_cache(cache: Path, spare: Path) -> Path:
    """Return the cache, or the spare folder where the cache cannot be written, or others could exchange its models."""
    try:
        cache.mkdir(FOLDER_MODE, parents=True, exist_ok=True)
        (cache / "models").mkdir(FOLDER_MODE, exist_ok=True)
        check_ours(cache, cache / "models")
        with tempfile.TemporaryFile(dir=cache / "models"):
            return cache
    except OSError as error:
        log.warning("models are kept until this worker ends only: --cache %s: %s", cache, error.strerror)
        return spare
    except NotOursError as error:
        log.error("--cache %s is not used: others could exchange its models: %s", cache, error)  # noqa: TRY400 - one line
        return spare


class ModelCache:
    """The folder `models` in a worker's cache; workers of one machine may share it."""

    def __init__(self, cache: Path) -> None:
        self.folder = cache / "models"
        self._own = secrets.token_hex(4)

    def path(self, model: PublishedModel) -> Path:
        """Return where a model's file is; its name is what the model is called in results."""
        return self.folder / f"{model.label}.{model.form}"

    def holds(self, model: PublishedModel) -> bool:
        """Whether the model's file is here and whole; a damaged one is removed. Reads the file."""
        file = self.path(model)
        try:
            if not file.exists():
                return False
            check_ours(file)
            if file.stat().st_size == model.size and digest_of(file) == model.digest:
                with suppress(OSError):  # of another user
                    file.touch()  # it is in use: see `_remove_all_but`
                return True
            log.warning("%s is damaged, and fetched again", file)
            file.unlink(missing_ok=True)
        except OSError as error:
            log.warning("%s cannot be read: %s", file, error.strerror)
        except NotOursError as error:
            log.warning("a cached model that others may write is fetched again: %s", error)
        return False

    async def fill(self, model: PublishedModel, fetch: Callable[[Path], Awaitable[None]]) -> None:
        """Have a model's file fetched to a path of its own, and keep it once it is whole.

        fetch: appends to what is there from an earlier call, which did not come to its end.

        Raises:
            DamagedModelError: the file that came has another digest.
            OSError: the cache cannot be written. Errors of `fetch` pass through.
        """
        part = self._own_file(self.path(model).name)
        await asyncio.to_thread(self._make_room, part)
        await fetch(part)
        if await asyncio.to_thread(digest_of, part) != model.digest:
            await asyncio.to_thread(part.unlink)
            raise DamagedModelError(f"what came of {model.label} has another digest than what was published")
        keep_others_out(part)
        part.replace(self.path(model))

    def remember(self, state: ModelRegistry) -> None:
        """Note what is run now, for a start without a monitor; and remove files that the registry no longer has.

        state: all models of the registry, and those in force here.
        """
        draft = self._own_file(LAST)
        try:
            self.folder.mkdir(FOLDER_MODE, parents=True, exist_ok=True)
            draft.write_bytes(msgspec.json.format(msgspec.json.encode(state)))
            keep_others_out(draft)
            draft.replace(self.folder / LAST)
            self._remove_all_but({self.path(each) for each in state.models})
        except OSError as error:
            log.warning(
                "a start without a monitor will not know this model: --cache %s: %s", self.folder, error.strerror
            )

    def recall(self) -> ModelRegistry | None:
        """Return what was run last; None if nothing was, it cannot be read, or others could have written it."""
        try:
            check_ours(self.folder / LAST)
            return msgspec.json.decode((self.folder / LAST).read_bytes(), type=ModelRegistry)
        except NotOursError as error:
            log.error("which model was run last is not taken from --cache %s: %s", self.folder, error)  # noqa: TRY400
        except (OSError, msgspec.MsgspecError, UnicodeError):
            pass
        return None

    def close(self) -> None:
        """Remove what was fetched in part."""
        with suppress(OSError):
            for part in self.folder.glob(f"*{self._own}{PART}"):
                part.unlink(missing_ok=True)

    def _own_file(self, name: str) -> Path:
        return self.folder / f"{name}.{self._own}{PART}"

    def _make_room(self, part: Path) -> None:
        """Make the folder; remove other parts of this process, and those of killed ones."""
        self.folder.mkdir(FOLDER_MODE, parents=True, exist_ok=True)
        for file in self.folder.glob(f"*{PART}"):
            if file != part and (self._own in file.name or _unused(file)):
                file.unlink(missing_ok=True)

    def _remove_all_but(self, known: Collection[Path]) -> None:
        """Remove models that the registry no longer has, once no worker of the machine can be about to load them."""
        for file in self.folder.glob("*@*.*"):
            if file.suffix in SUFFIXES and file not in known and _unused(file):
                file.unlink(missing_ok=True)


def _unused(file: Path) -> bool:
    try:
        return time.time() - file.stat().st_mtime > UNUSED_S
    except FileNotFoundError:  # another worker was quicker
        return False
