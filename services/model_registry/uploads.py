"""Files that are being published, until they are complete. For one thread."""

import logging
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from schemas.models import PIECE_BYTES, ModelUpload, PublishedModel, piece_bytes, pieces_of
from services.model_registry.folder import RegistryError

log = logging.getLogger(__name__)

MAX_UPLOADS: Final = 4
"""Files that are being published at once."""

UPLOAD_IDLE_S: Final = 120.0
"""Seconds without a piece after which an upload ends."""

SPARE_BYTES: Final = 64 << 20
"""Room that publishing leaves on the disk, for the registry's state and whatever else is there."""


@dataclass(slots=True)
class Upload:
    """A file that is being published. missing: the pieces that it lacks. touched_s: when one came (steady clock)."""

    model: PublishedModel
    file: Path
    missing: set[int]
    touched_s: float

    def write(self, piece: ModelUpload, now_s: float) -> None:
        """Write a piece to the file.

        Raises:
            RegistryError: it has another size than it should have.
            OSError: it cannot be written.
        """
        if len(piece.data) != piece_bytes(self.model.size, piece.index) or not len(piece.data):
            raise RegistryError(
                f"a piece {piece.index} of {len(piece.data)} bytes does not belong to {self.model.name}"
            )
        with self.file.open("r+b") as file:
            file.seek(piece.index * PIECE_BYTES)
            file.write(piece.data)
        self.missing.discard(piece.index)
        self.touched_s = now_s


class Uploads:
    """The files in a folder of their own. Half a file is worth nothing after a restart, and removed.

    Raises:
        OSError: the folder cannot be used.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._under_way: dict[str, Upload] = {}
        shutil.rmtree(folder, ignore_errors=True)  # one that cannot be removed stays: it is worth nothing
        folder.mkdir(exist_ok=True)

    def of(self, model: PublishedModel, published: Iterable[PublishedModel], now_s: float) -> Upload:
        """Return the upload of a model, which may begin with this. published: the models that are there already.

        Raises:
            RegistryError: the name or the room is taken.
            OSError: it cannot be written.
        """
        self.end_idle(now_s)
        if found := self._under_way.get(model.digest):
            if (found.model.name, found.model.size) != (model.name, model.size):
                raise RegistryError(f"this file is being published as {found.model.name} by {found.model.by}")
            return found
        for other in (*published, *(each.model for each in self._under_way.values())):
            if other.name == model.name:
                raise RegistryError(f"{model.name} is the name of {other.label}: give this one another (--name)")
        if len(self._under_way) >= MAX_UPLOADS:
            raise RegistryError(f"{MAX_UPLOADS} models are being published already: try again in a minute or two")
        self._check_room(model)
        file = self._folder / model.digest
        file.touch()
        made = self._under_way[model.digest] = Upload(model, file, set(range(pieces_of(model.size))), now_s)
        return made

    def end_idle(self, now_s: float) -> None:
        """Remove the files of which no piece came for UPLOAD_IDLE_S."""
        for digest, upload in list(self._under_way.items()):
            if now_s - upload.touched_s > UPLOAD_IDLE_S:
                log.warning("%s was not published: no more of it came", upload.model.label)
                self.drop(digest)

    def drop(self, digest: str) -> None:
        """Forget an upload and remove its file, if there is one."""
        if (upload := self._under_way.pop(digest, None)) is not None:
            upload.file.unlink(missing_ok=True)

    def _check_room(self, model: PublishedModel) -> None:
        under_way = sum(len(each.missing) for each in self._under_way.values()) * PIECE_BYTES
        free = shutil.disk_usage(self._folder).free - under_way - SPARE_BYTES
        if free < model.size:
            raise RegistryError(
                f"{model.name} has {model.size / 1e6:.1f} MB, and the disk of {self._folder.parent} has room for"
                f" {max(0, free) / 1e6:.1f} MB: make room there"
            )
