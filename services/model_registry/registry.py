"""Published weights in a folder: the files by their SHA-256, and which of them are in force. For one thread."""

import hashlib
import logging
import os
import time
from pathlib import Path
from typing import Final

import msgspec

from schemas.models import (
    MAX_MODELS,
    PIECE_BYTES,
    SHORT_DIGEST,
    ModelPiece,
    ModelPieceRequest,
    ModelRegistry,
    ModelUpload,
    ModelUse,
    PublishedModel,
    piece_bytes,
    pieces_of,
)
from services.model_registry.folder import UPLOADS, ModelFolder, RegistryError
from services.model_registry.uploads import Upload, Uploads

log = logging.getLogger(__name__)

DAMAGED: Final = "is damaged: it has another digest than what was published"


def digest_of(file: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal.

    Raises:
        OSError: it cannot be read.
    """
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


class Registry:
    """The models in a folder, which no other process serves until `close`.

    Beyond MAX_MODELS, publishing removes the oldest model that is neither in force, nor was before, nor is a canary.

    Raises:
        FolderInUseError: another process serves the folder.
        RegistryError: the folder cannot be used.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = ModelFolder(folder)
        self._withdrawn: dict[str, str] = {}
        try:
            self._uploads = Uploads(folder / UPLOADS)
            self.state = self._folder.load()
            for model in self.state.models:
                if why := self._lacks(model):
                    self.withdraw(model.digest, why)
        except OSError as error:
            self._folder.close()
            raise RegistryError(f"--models {folder}: {error.strerror}") from error

    @property
    def problems(self) -> tuple[str, ...]:
        """Models that were lost, and what helps, in lines. For any thread."""
        lost = tuple(self._withdrawn.values())
        return lost if self.state.in_force or not self._folder.damage else (self._folder.damage, *lost)

    def close(self) -> None:
        """Let another process serve the folder."""
        self._folder.close()

    def why_damaged(self, model: PublishedModel) -> str:
        """Return why a model's file is not the one that was published, or empty. Reads all of it. For any thread."""
        try:
            return self._lacks(model) or ("" if digest_of(self._folder.file(model)) == model.digest else DAMAGED)
        except OSError as error:
            return f"cannot be read ({error.strerror})"

    def withdraw(self, digest: str, why: str) -> None:
        """Serve a model no longer; why: what is wrong with its file.

        The state on the disk stays until the next change, so that a file that is restored counts again after a restart.
        """
        state = self.state
        if (model := state.find(digest)) is None:
            return
        models = [each for each in state.models if each.digest != digest]
        gone = {name: "" for name in ("in_force", "before", "canary") if getattr(state, name) == digest}
        robots = [] if "canary" in gone else state.robots
        self.state = _replaced(state, models=models, robots=robots, **gone)
        was = ", which was in force," if digest == state.in_force else ""
        self._withdrawn = {
            **self._withdrawn,
            digest: f"{model.label}{was} is withdrawn: {self._folder.file(model)} {why}; publish it again"
            + (" and put it in force" if was else ""),
        }
        log.error("%s", self._withdrawn[digest])

    def use(self, asked: ModelUse) -> None:
        """Put a model in force, or make it a canary, or go back; see `ModelUse`.

        Raises:
            RegistryError: no such model, nothing to go back to, or the state cannot be written.
        """
        before = self.state
        if not asked.digest:
            state = self._gone_back(asked.leaving)
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
        if state.in_force != before.in_force:
            self._withdrawn = {}  # whoever changed it knows what there is

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
            with self._folder.file(model).open("rb") as file:
                file.seek(asked.index * PIECE_BYTES)
                data = file.read(size)
        except OSError as error:
            raise RegistryError(f"{model.name} cannot be read: {error.strerror}") from error
        return ModelPiece(digest=asked.digest, index=asked.index, data=memoryview(data))

    def take(self, piece: ModelUpload, now_s: float) -> list[int]:
        """Take a piece of a file that is being published; return the pieces that it lacks. Publish a complete file.

        now_s: on a steady clock.

        Raises:
            RegistryError: the name or the room is taken, the piece or the whole file is another one than it should be,
                or it cannot be written.
        """
        model = piece.model
        if self.state.find(model.digest) is not None:
            return []
        try:
            upload = self._uploads.of(model, self.state.models, now_s)
            upload.write(piece, now_s)
            if not upload.missing:
                self._publish(upload)
        except OSError as error:
            self._uploads.drop(model.digest)
            raise RegistryError(f"{model.name} cannot be kept: {error.strerror}") from error
        return sorted(upload.missing)

    def end_idle_uploads(self, now_s: float) -> None:
        """Remove half a file of which no piece came for a while. now_s: on the clock of `take`."""
        self._uploads.end_idle(now_s)

    def _lacks(self, model: PublishedModel) -> str:
        """Return why a file cannot be the model's without reading it, or empty. Raises OSError."""
        file = self._folder.file(model)
        if not file.is_file():
            return "is gone"
        size = file.stat().st_size
        return "" if size == model.size else f"has {size} bytes instead of {model.size}"

    def _gone_back(self, leaving: str) -> ModelRegistry:
        state = self.state
        now = state.canary or state.in_force
        if leaving and leaving != now:
            left, there = state.find(leaving), state.find(now)
            raise RegistryError(
                f"{leaving[:SHORT_DIGEST] if left is None else left.label} was left meanwhile: now going back would"
                f" leave {'no model' if there is None else there.label}; look again: fleetsight model list"
            )
        if state.canary:
            return _replaced(state, canary="", robots=[])
        if not state.before:
            raise RegistryError(
                "there is no model to go back to: none was in force before the one that is, or going back was done"
                " already; fleetsight model use NAME puts any model in force"
            )
        return _replaced(state, in_force=state.before, before="")

    def _publish(self, upload: Upload) -> None:
        model = msgspec.structs.replace(upload.model, published_ns=time.time_ns())
        with upload.file.open("r+b") as file:
            os.fsync(file.fileno())
        if digest_of(upload.file) != model.digest:
            self._uploads.drop(model.digest)
            raise RegistryError(f"{model.name}: what arrived has another digest than the file: publish it again")
        kept = self._folder.file(model)
        upload.file.replace(kept)
        self._uploads.drop(model.digest)
        models = [*self.state.models, model]
        in_use = {self.state.in_force, self.state.before, self.state.canary}
        unused = [each for each in models if each.digest not in in_use]
        left_out = unused[0] if len(models) > MAX_MODELS else None
        try:
            self._write(_replaced(self.state, models=[each for each in models if each is not left_out]))
        except RegistryError:
            kept.unlink(missing_ok=True)
            raise
        self._withdrawn = {digest: lost for digest, lost in self._withdrawn.items() if digest != model.digest}
        if left_out is not None:
            self._folder.file(left_out).unlink(missing_ok=True)
            log.info("%s, the oldest that is not in use, is removed: %d models are kept", left_out.label, MAX_MODELS)
        log.info("%s is published by %s: %s", model.label, model.by, model.about)

    def _write(self, state: ModelRegistry) -> None:
        self._folder.write(state)
        self.state = state


def _replaced(state: ModelRegistry, **fields: object) -> ModelRegistry:
    return msgspec.structs.replace(state, **fields)
