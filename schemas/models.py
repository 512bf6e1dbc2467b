"""The model registry: published weights, which of them are in force, and the pieces in which files travel.

Also how a picture is asked for that a model is to learn from.
"""

from typing import Annotated, Final, Literal

import msgspec

from schemas.header import Count, Label, Name, Nanoseconds

PIECE_BYTES: Final = 512 << 10
"""Bytes of each piece of a file but the last: larger requests and replies may be lost on a busy link."""

MAX_MODEL_BYTES: Final = 1 << 30
MAX_PIECES: Final = MAX_MODEL_BYTES // PIECE_BYTES
MAX_MODELS: Final = 20
"""Published models that are kept."""

MAX_CANARY_ROBOTS: Final = 1_000
SHORT_DIGEST: Final = 12
"""Letters of a digest that are shown."""

Digest = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}$(?!\n)")]
"""The SHA-256 of a file, in hexadecimal."""

MaybeDigest = Annotated[str, msgspec.Meta(pattern=r"^([0-9a-f]{64})?$(?!\n)")]
PieceIndex = Annotated[int, msgspec.Meta(ge=0, lt=MAX_PIECES)]


class PublishedModel(msgspec.Struct, frozen=True, kw_only=True):
    """Weights in the registry, known by their digest and by a name that no other model there has.

    size: bytes. by: the user and machine that published it, as they called themselves. about: what it detects, in
    words. published_ns: nanoseconds since the epoch. form: how its file ends, of Ultralytics' weights or of an ONNX
    file, which workers without torch run.
    """

    digest: Digest
    name: Name
    size: Annotated[int, msgspec.Meta(ge=1, le=MAX_MODEL_BYTES)]
    by: Label = ""
    about: Label = ""
    published_ns: Nanoseconds = 0
    form: Literal["pt", "onnx"] = "pt"

    @property
    def label(self) -> str:
        """Its name and the beginning of its digest: how results and workers call it."""
        return f"{self.name}@{self.digest[:SHORT_DIGEST]}"


class ModelRegistry(msgspec.Struct, frozen=True, kw_only=True):
    """All published models, by age, and the digests of those in use; empty where there is none.

    in_force: what workers with `--model fleet` run. before: what was in force before it; empty once that was gone back
    to. canary: what looks at the cameras of `robots` instead. registry, since_ns: the process that says so, and since
    when it serves the registry, nanoseconds since the epoch. Of several at once the first by since_ns, then by
    registry, goes on; the others end.
    """

    models: Annotated[list[PublishedModel], msgspec.Meta(max_length=MAX_MODELS)]
    in_force: MaybeDigest = ""
    before: MaybeDigest = ""
    canary: MaybeDigest = ""
    robots: Annotated[list[Name], msgspec.Meta(max_length=MAX_CANARY_ROBOTS)] = []
    registry: Label = ""
    since_ns: Nanoseconds = 0

    def find(self, digest: str) -> PublishedModel | None:
        """Return the model of a digest."""
        return next((each for each in self.models if each.digest == digest), None)


class ModelPieceRequest(msgspec.Struct, frozen=True, kw_only=True):
    """Asks for a piece of a published file. index: from 0, in pieces of PIECE_BYTES."""

    digest: Digest
    index: PieceIndex


class ModelPiece(msgspec.Struct, frozen=True, kw_only=True):
    """A piece of a published file; decoded without a copy."""

    digest: Digest
    index: PieceIndex
    data: memoryview


class ModelUpload(msgspec.Struct, frozen=True, kw_only=True):
    """A piece of a file that is being published. model: all about it but `published_ns`."""

    model: PublishedModel
    index: PieceIndex
    data: memoryview


class ModelUploadAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """The pieces of a file that the registry still lacks; none once it is published."""

    missing: Annotated[list[PieceIndex], msgspec.Meta(max_length=MAX_PIECES)]


class ModelUse(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Puts a model in force; with robots, as a canary for their cameras alone.

    digest: empty to go back: a canary ends, else the model that was in force before is so again. leaving: with an empty
    digest, the canary, or else the model in force, that this leaves; where that is another one by now, nothing is done.
    """

    digest: MaybeDigest
    robots: Annotated[list[Name], msgspec.Meta(max_length=MAX_CANARY_ROBOTS)] = []
    leaving: MaybeDigest = ""


class PictureRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Asks for a picture of a camera to be saved in a data set. by: who asks."""

    robot: Name
    camera: Name
    by: Label = ""


class SavedPicture(msgspec.Struct, frozen=True, kw_only=True):
    """A picture that was saved.

    file: its path in the data set. folder: the data set's, on the machine of whoever saved it. objects: how many its
    draft of labels has, if it has one.
    """

    file: Label
    folder: Label
    objects: Count | None = None


def pieces_of(size: int) -> int:
    """Return the number of pieces of a file of `size` bytes."""
    return -(-size // PIECE_BYTES)


def piece_bytes(size: int, index: int) -> int:
    """Return the number of bytes of a piece of a file of `size` bytes; 0 for one beyond its end."""
    return max(0, min(PIECE_BYTES, size - index * PIECE_BYTES))
