"""A folder of pictures and labels in Ultralytics' form: where its parts are, and which labels a person has seen.

Each of `train`, `val` and `test` has `images/` and `labels/`; `data.yaml` names the classes by number. A line of
`collected.jsonl` names a picture that `fleetsight collect` saved, with the model that drafted its labels, if one did; a
line of `labelled.jsonl` one whose labels `fleetsight labels import` took from a person.
"""

import json
from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

import yaml

from schemas.printing import printable
from services.whole_file import write_whole

SPLITS: Final = ("train", "val", "test")
IMAGE_SUFFIXES: Final = (".jpg", ".jpeg", ".png")
NAMES: Final = "data.yaml"
COLLECTED: Final = "collected.jsonl"
LABELLED: Final = "labelled.jsonl"


class DatasetError(Exception):
    """The folder cannot be used; the message names the file and the cure."""


class Origin(StrEnum):
    """The origin of a picture's labels."""

    PERSON = "labelled"
    DRAFT = "with drafts"
    UNKNOWN = "labelled elsewhere"
    NONE = "without labels"


def images_in(folder: Path, *splits: str) -> list[Path]:
    """Return the pictures of these splits, in the order of their names."""
    found = (file for split in splits for file in (folder / split / "images").glob("*"))
    return sorted(file for file in found if file.suffix.lower() in IMAGE_SUFFIXES)


def labels_of(image: Path) -> Path:
    """Return the file of a picture's labels, which may be missing."""
    return image.parents[1] / "labels" / f"{image.stem}.txt"


def names_in(file: Path) -> list[str]:
    """Return the classes that a data.yaml names, in the order of their numbers; none if there is no such file.

    Raises:
        DatasetError: it does not name them.
    """
    if not file.exists():
        return []
    try:
        names = yaml.safe_load(file.read_text(encoding="utf-8"))["names"]
        listed = [names[code] for code in range(len(names))]
    except (yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError, IndexError) as error:
        raise DatasetError(f"{printable(str(file))}: it has no names of classes by number; remove it") from error
    return [str(name) for name in listed]


def write_names(file: Path, names: list[str], **other: Any) -> None:
    """Write a data.yaml with these names of classes. other: its further keys."""
    write_whole(file, description_of(names, **other))


def description_of(names: Sequence[str], **other: Any) -> bytes:
    """Return the content of a data.yaml; see `write_names`."""
    content = {**other, "names": dict(enumerate(names))}
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True).encode()


class Origins:
    """Tells whose labels the pictures of a folder have, from its records. drafts_by: the model, by picture."""

    def __init__(self, folder: Path) -> None:
        """Read the records.

        Raises:
            DatasetError: a line is damaged.
            OSError: a file cannot be read.
        """
        self._folder = folder
        collected = _lines(folder / COLLECTED)
        self.drafts_by = {each["file"]: str(each["drafts_by"]) for each in collected if "drafts_by" in each}
        self._seen = {each["file"] for each in _lines(folder / LABELLED)}

    def of(self, image: Path) -> Origin:
        """Return the origin of a picture's labels."""
        if not labels_of(image).exists():
            return Origin.NONE
        name = image.relative_to(self._folder).as_posix()
        if name in self._seen:
            return Origin.PERSON
        return Origin.DRAFT if name in self.drafts_by else Origin.UNKNOWN


def _lines(file: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a record, without the half of one that a killed process left at its end."""
    text = file.read_text(encoding="utf-8", errors="replace") if file.exists() else ""
    for number, line in enumerate(text.rpartition("\n")[0].splitlines(), 1):
        try:
            about = {**json.loads(line)}
            about["file"] = str(about["file"])
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise DatasetError(f"{printable(str(file))}: line {number} is damaged; remove it") from error
        yield about


def cut_torn(record: Path) -> None:
    """Remove the half of a line that a killed process left at a record's end.

    Raises:
        OSError: it cannot be read or written.
    """
    content = record.read_bytes() if record.exists() else b""
    if content and not content.endswith(b"\n"):
        record.write_bytes(content[: content.rfind(b"\n") + 1])
