"""Published weights in a folder: the files by their SHA-256, and which of them are in force. For one thread."""

import hashlib
import logging
import os
import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from schemas.models import (
    MAX_MODELS,
    PIECE_BYTES,
    ModelPiece,
    ModelPieceRequest,
    ModelRegistry,
    ModelUpload,
    ModelUse,
    PublishedModel,
    piece_bytes,
    pieces_of,
)
from services.whole_file import write_whole

log = logging.getLogger(__name__)

STATE_FILE: Final = "registry.json"
UPLOADS: Final = "uploads"
MAX_UPLOADS: Final = 4
"""Files that are being published at once."""

UPLOAD_IDLE_S: Final = 120.0
"""Seconds without a piece after which an upload gives way to another one."""


class RegistryError(Exception):
    """The registry cannot do it; the message says why, and what helps."""


@dataclass(slots=True)
class _Upload:
    """A file that is being published. missing: the pieces that it lacks. touched_s: when one came (steady clock)."""

    model: PublishedModel
    file: Path
    missing: set[int]
    touched_s: float


def digest_of(file: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal.

    Raises:
        OSError: it cannot be read.
    """
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


class Registry:
    """The models in a folder, of which no other process may write.

    Beyond MAX_MODELS, publishing removes the oldest model that is neither in force, nor was before, nor is a canary.

    Raises:
        RegistryError: the folder cannot be used, or its state not be read.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._uploads: dict[str, _Upload] = {}
        try:
            shutil.rmtree(folder / UPLOADS, ignore_errors=True)  # half a file is worth nothing after a restart
            (folder / UPLOADS).mkdir(parents=True)
            self.state = self._load()
        except OSError as error:
            raise RegistryError(f"--models {folder}: {error.strerror}") from error

    def use(self, asked: ModelUse) -> None:
        """Put a model in force, or make it a canary, or go back; see `ModelUse`.

        Raises:
            RegistryError: no such model, nothing to go back to, or the state cannot be written.
        """
        before = self.state
        if not asked.digest:
            state = self._gone_back()
        elif before.find(asked.digest) is None:
            raise RegistryError(f"no published model has the digest {asked.digest}")
        elif not asked.robots:
            changed = before.before if asked.digest == before.in_force else before.in_force
            state = _replaced(before, in_force=asked.digest, before=changed, canary="", robots=[])
        elif not before.in_force:
            raise RegistryError("no model is in force: use one for all robots first, a canary is beside it")
        elif asked.digest == before.in_force:
            raise RegistryError("this model is in force for all robots already: a canary is another one")
        else:
            robots = sorted(set(asked.robots))
            state = _replaced(before, canary=asked.digest, robots=robots)
        self._write(state)

    def piece(self, asked: ModelPieceRequest) -> ModelPiece:
        """Return a piece of a published file.

        Raises:
            RegistryError: no such model or piece, or the file cannot be read.
        """
        model = self.state.find(asked.digest)
        if model is None:
            raise RegistryError(f"no published model has the digest {asked.digest}")
        size = piece_bytes(model.size, asked.index)
        if not size:
            raise RegistryError(f"{model.name} has {pieces_of(model.size)} pieces, and none with index {asked.index}")
        try:
            with self._file(model.digest).open("rb") as file:
                file.seek(asked.index * PIECE_BYTES)
                data = file.read(size)
        except OSError as error:
            raise RegistryError(f"{model.name} cannot be read: {error.strerror}") from error
        return ModelPiece(digest=asked.digest, index=asked.index, data=memoryview(data))

    def take(self, upload: ModelUpload, now_s: float) -> list[int]:
        """Take a piece of a file that is being published; return the pieces that it lacks. Publish a complete file.

        now_s: on a steady clock.

        Raises:
            RegistryError: the name or the room is taken, the piece or the whole file is another one than it should be,
                or it cannot be written.
        """
        model = upload.model
        if self.state.find(model.digest) is not None:
            return []
        under_way = self._upload(model, now_s)
        if len(upload.data) != piece_bytes(model.size, upload.index) or not len(upload.data):
            raise RegistryError(f"a piece {upload.index} of {len(upload.data)} bytes does not belong to {model.name}")
        try:
            with under_way.file.open("r+b") as file:
                file.seek(upload.index * PIECE_BYTES)
                file.write(upload.data)
            under_way.missing.discard(upload.index)
            under_way.touched_s = now_s
            if not under_way.missing:
                self._publish(under_way)
        except OSError as error:
            self._drop(model.digest)
            raise RegistryError(f"{model.name} cannot be kept: {error.strerror}") from error
        return sorted(under_way.missing)

    def _load(self) -> ModelRegistry:
        file = self._folder / STATE_FILE
        if not file.exists():
            return ModelRegistry(models=[])
        try:
            state = msgspec.json.decode(file.read_bytes(), type=ModelRegistry)
        except (msgspec.MsgspecError, UnicodeError) as error:
            raise RegistryError(
                f"--models {self._folder}: {STATE_FILE} is damaged ({error}): restore it from a backup, or remove it"
                " and publish the models again"
            ) from error
        there = [each for each in state.models if self._is_whole(each)]
        for lost in (each for each in state.models if each not in there):
            log.warning("--models %s: the file of %s is gone, and so is the model", self._folder, lost.label)
        known = {each.digest for each in there}
        gone = {name: "" for name in ("in_force", "before", "canary") if getattr(state, name) not in known}
        robots = state.robots if state.canary in known else []
        return msgspec.structs.replace(state, models=there, robots=robots, **gone)

    def _is_whole(self, model: PublishedModel) -> bool:
        file = self._file(model.digest)
        return file.is_file() and file.stat().st_size == model.size

    def _gone_back(self) -> ModelRegistry:
        state = self.state
        if state.canary:
            return _replaced(state, canary="", robots=[])
        if not state.before:
            raise RegistryError("there is no model to go back to: none was in force before")
        return _replaced(state, in_force=state.before, before=state.in_force)

    def _upload(self, model: PublishedModel, now_s: float) -> _Upload:
        for digest in [each for each, old in self._uploads.items() if now_s - old.touched_s > UPLOAD_IDLE_S]:
            self._drop(digest)
        if found := self._uploads.get(model.digest):
            if (found.model.name, found.model.size) != (model.name, model.size):
                raise RegistryError(f"this file is being published as {found.model.name} by {found.model.by}")
            return found
        under_way = [each.model for each in self._uploads.values()]
        for other in (*self.state.models, *under_way):
            if other.name == model.name:
                raise RegistryError(f"{model.name} is the name of {other.label}: give this one another (--name)")
        if len(self._uploads) >= MAX_UPLOADS:
            raise RegistryError(f"{MAX_UPLOADS} models are being published already: try again in a minute or two")
        file = self._folder / UPLOADS / model.digest
        try:
            file.touch()
        except OSError as error:
            raise RegistryError(f"{model.name} cannot be kept: {error.strerror}") from error
        made = self._uploads[model.digest] = _Upload(model, file, set(range(pieces_of(model.size))), now_s)
        return made

    def _publish(self, upload: _Upload) -> None:
        model = msgspec.structs.replace(upload.model, published_ns=time.time_ns())
        with upload.file.open("r+b") as file:
            os.fsync(file.fileno())
        if digest_of(upload.file) != model.digest:
            self._drop(model.digest)
            raise RegistryError(f"{model.name}: what arrived has another digest than the file: publish it again")
        upload.file.replace(self._file(model.digest))
        del self._uploads[model.digest]
        models = [*self.state.models, model]
        in_use = {self.state.in_force, self.state.before, self.state.canary}
        unused = [each for each in models if each.digest not in in_use]
        left_out = unused[0] if len(models) > MAX_MODELS else None
        self._write(_replaced(self.state, models=[each for each in models if each is not left_out]))
        if left_out is not None:
            self._file(left_out.digest).unlink(missing_ok=True)
            log.info("%s, the oldest that is not in use, is removed: %d models are kept", left_out.label, MAX_MODELS)
        log.info("%s is published by %s: %s", model.label, model.by, model.about)

    def _drop(self, digest: str) -> None:
        if (upload := self._uploads.pop(digest, None)) is not None:
            upload.file.unlink(missing_ok=True)

    def _write(self, state: ModelRegistry) -> None:
        try:
            write_whole(self._folder / STATE_FILE, msgspec.json.format(msgspec.json.encode(state)))
        except OSError as error:
            raise RegistryError(f"{self._folder / STATE_FILE} cannot be written: {error.strerror}") from error
        self.state = state

    def _file(self, digest: str) -> Path:
        return self._folder / f"{digest}.pt"


def _replaced(state: ModelRegistry, **fields: object) -> ModelRegistry:
    return msgspec.structs.replace(state, **fields)
