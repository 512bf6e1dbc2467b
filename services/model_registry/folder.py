"""The folder of a model registry: its lock, its state and where its files are. For one thread."""

import fcntl
import logging
from pathlib import Path
from typing import Final

import msgspec

from schemas.models import ModelRegistry, PublishedModel
from services.whole_file import write_whole

log = logging.getLogger(__name__)

STATE_FILE: Final = "registry.json"
DAMAGED_FILE: Final = "registry.json.damaged"
LOCK_FILE: Final = "lock"
UPLOADS: Final = "uploads"


class RegistryError(Exception):
    """The registry cannot do it; the message says why, and what helps."""


class FolderInUseError(RegistryError):
    """Another process serves the folder."""


class ModelFolder:
    """A folder that no other process serves until this one closes it.

    damage: why the state that was there could not be read, and what helps; else empty.

    Raises:
        FolderInUseError: another process serves it.
        RegistryError: it cannot be used.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage = ""
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._lock = (path / LOCK_FILE).open("ab")
        except OSError as error:
            raise RegistryError(f"--models {path}: {error.strerror}") from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._lock.close()
            if isinstance(error, BlockingIOError):
                raise FolderInUseError(
                    f"--models {path}: another process serves this folder: give one monitor --models"
                ) from error
            raise RegistryError(f"--models {path} cannot be locked: {error.strerror}") from error

    def close(self) -> None:
        """Let another process serve it."""
        self._lock.close()

    def file(self, model: PublishedModel) -> Path:
        """Return where a model's file is."""
        return self.path / f"{model.digest}.{model.form}"

    def load(self) -> ModelRegistry:
        """Return the state; an empty one where there is none or it is damaged, which is then put aside.

        Raises:
            OSError: it cannot be read, or not be put aside.
        """
        file, damaged = self.path / STATE_FILE, self.path / DAMAGED_FILE
        try:
            return msgspec.json.decode(file.read_bytes(), type=ModelRegistry)
        except FileNotFoundError:
            if not damaged.exists():
                return ModelRegistry(models=[])
            why = ""
        except (msgspec.MsgspecError, UnicodeError) as error:
            file.replace(damaged)
            why = f" ({error})"
        self.damage = (
            f"--models {self.path}: {STATE_FILE} was damaged{why} and is now {DAMAGED_FILE}, so no model is in force,"
            f" and detectors go on with what they run: restore {STATE_FILE} from a backup and start the monitor again,"
            " or publish the models again"
        )
        log.error("%s", self.damage)
        return ModelRegistry(models=[])

    def write(self, state: ModelRegistry) -> None:
        """Keep a state; once this returns, it survives a power cut.

        Raises:
            RegistryError: it cannot be written.
        """
        file = self.path / STATE_FILE
        try:
            write_whole(file, msgspec.json.format(msgspec.json.encode(state)), durable=True)
        except OSError as error:
            raise RegistryError(f"{file} cannot be written: {error.strerror}") from error
