"""Reads what a labelling tool gave back: a file, an archive or a folder, of a form that is told by its content."""

import codecs
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Final

from schemas.printing import printable
from services.toolbox.labels import coco, cvat, label_studio, yolo
from services.toolbox.labels.objects import LabelsError, PictureLabels
from services.toolbox.labels.settings import Form

MAX_BYTES: Final = 256 << 20
"""Size of all labels of an import, unpacked."""

MAX_MEMBERS: Final = 500_000
"""Number of files in an archive or a folder."""

SUFFIXES: Final = (".json", ".xml")
KNOWN: Final = (*SUFFIXES, ".txt", ".yaml", ".yml")


@dataclass(slots=True)
class Source:
    """The files that an import reads. members: reads at most so many bytes of each, by its name; "" is a lone file."""

    where: str
    members: Mapping[str, Callable[[int], bytes]]
    room: int = field(default_factory=lambda: MAX_BYTES)

    def place(self, member: str) -> str:
        """Return a file's name in messages."""
        return f"{self.where}: {printable(member)}" if member else self.where

    def read(self, member: str) -> bytes:
        """Return the content of a file.

        Raises:
            LabelsError: it cannot be read, or is too large together with those read before.
        """
        try:
            content = self.members[member](self.room + 1)
        except OSError as error:
            raise LabelsError(f"{self.place(member)}: {error.strerror or error}") from error
        except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError) as error:  # the latter of a password
            raise LabelsError(f"{self.place(member)}: damaged, or locked by a password; export it again") from error
        self.room -= len(content)
        if self.room < 0:
            raise LabelsError(f"{self.place(member)}: more than {MAX_BYTES >> 20} MiB of labels; import it in parts")
        return content.removeprefix(codecs.BOM_UTF8)

    def text(self, member: str) -> str:
        """Return the content of a file of text.

        Raises:
            LabelsError: it cannot be read, or is not UTF-8.
        """
        try:
            return self.read(member).decode()
        except UnicodeDecodeError as error:
            raise LabelsError(f"{self.place(member)}: not UTF-8; export it again") from error


def read_source(file: Path, form: Form | None) -> tuple[Form, list[PictureLabels]]:
    """Return the form and the labels of what a tool exported. form: None to tell it by the content.

    Raises:
        LabelsError: it cannot be read, is too large, or is of no form that is known here.
    """
    with _opened(file) as source:
        if form is Form.YOLO or (form is None and any(map(yolo.is_labels, source.members))):
            return Form.YOLO, list(yolo.read(list(source.members), source.text, source.where))
        files = sorted(each for each in source.members if not each or PurePosixPath(each).suffix.lower() in SUFFIXES)
        if not files:
            raise LabelsError(f"{source.where}: no labels of a known form are in it; name what the tool exported")
        forms, found = set[Form](), list[PictureLabels]()
        for member in files:
            content, place = source.read(member), source.place(member)
            forms.add(kind := form or _form_of(content, place))
            found += READERS[kind](content, place)
    if len(forms) > 1:
        raise LabelsError(f"{source.where}: several forms are in it: {', '.join(sorted(forms))}; name a file of one")
    return forms.pop(), found


READERS: Final[Mapping[Form, Callable[[bytes, str], Iterator[PictureLabels]]]] = {
    Form.COCO: coco.read,
    Form.CVAT: cvat.read,
    Form.LABEL_STUDIO: label_studio.read,
}


def _form_of(content: bytes, place: str) -> Form:
    match content.lstrip()[:1]:
        case b"<":
            return Form.CVAT
        case b"[":
            return Form.LABEL_STUDIO
        case b"{":
            return Form.COCO
    raise LabelsError(f"{place}: neither JSON nor XML; export COCO, CVAT for images 1.1, JSON of Label Studio or YOLO")


@contextmanager
def _opened(file: Path) -> Iterator[Source]:
    where = printable(str(file))
    try:
        if file.is_dir():
            every = (each for each in file.rglob("*") if each.suffix in KNOWN and each.is_file())
            yield Source(
                where, _few({each.relative_to(file).as_posix(): partial(_start, each) for each in every}, where)
            )
        elif zipfile.is_zipfile(file):
            with zipfile.ZipFile(file) as archive:
                yield Source(where, _few({name: partial(_unpack, archive, name) for name in archive.namelist()}, where))
        elif file.is_file():
            yield Source(where, {"": partial(_start, file)})
        else:
            raise LabelsError(f"{where}: no such file; name what the labelling tool exported")
    except OSError as error:
        raise LabelsError(f"{where}: {error.strerror or error}") from error
    except (zipfile.BadZipFile, NotImplementedError, ValueError) as error:
        raise LabelsError(f"{where}: a damaged archive; export it again") from error


def _few(members: Mapping[str, Callable[[int], bytes]], where: str) -> Mapping[str, Callable[[int], bytes]]:
    if len(members) > MAX_MEMBERS:
        raise LabelsError(f"{where}: more than {MAX_MEMBERS} files are in it; import it in parts")
    return members


def _start(file: Path, most: int) -> bytes:
    with file.open("rb") as stream:
        return stream.read(most)


def _unpack(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    with archive.open(name) as stream:
        return stream.read(most)
