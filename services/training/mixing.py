"""Mixes photographs with rendered pictures in one data set, see `partial_labels` for its classes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from services.data_folder import description_of
from services.training.files import TrainingError, keep_file
from services.training.partial_labels import LabelKind, code_names
from services.training.photographs import Photograph

MOST_REPEATS: Final = 4
"""How often a photograph is taken in an epoch, at most, to balance rendered pictures."""

EMPTY_REPEATS: Final = 4
"""How often a photograph without any of the classes is taken for each time that another one is: there are few of them,
and each has a lot to be mistaken for something."""


@dataclass(frozen=True, slots=True)
class MadePictures:
    """How many pictures were made of photographs: collages, and plain ones."""

    collages: int = 0
    plain: int = 0


NONE_MADE: Final = MadePictures()

EVERYWHERE: Final = "0 0 1 0 1 1 0 1"


def write_mix(
    folder: Path, photographs: Sequence[Photograph], rendered: Sequence[Path], classes: Sequence[str]
) -> Path:
    """Copy the photographs into `folder`, list them with the rendered pictures, and return the data set's YAML.

    classes: names by number. Photographs are listed as often as it takes to have about as many of them as rendered
    ones; those without any of the classes come on top.

    Raises:
        TrainingError: a photograph cannot be read, or a file cannot be written.
    """
    for kind in ("images", "labels"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    copies = [_copied(folder, number, photograph, len(classes)) for number, photograph in enumerate(photographs)]
    repeats = min(max(1, -(-len(rendered) // max(1, len(copies)))), MOST_REPEATS)
    empty = [copy for copy, each in zip(copies, photographs, strict=True) if each.empty]
    listed = "".join(f"{path.resolve()}\n" for path in [*(copies + empty * (EMPTY_REPEATS - 1)) * repeats, *rendered])
    keep_file(folder / "train.txt", listed.encode())
    description = folder / "mix.yaml"
    told = description_of(code_names(classes), path=str(folder.resolve()), train="train.txt", val="train.txt")
    keep_file(description, told)
    return description


def _copied(folder: Path, number: int, photograph: Photograph, classes: int) -> Path:
    name = f"{number:06d}"
    copy = folder / "images" / f"{name}{photograph.file.suffix.lower()}"
    try:
        content = photograph.file.read_bytes()
    except OSError as error:
        raise TrainingError(f"{photograph.file}: {error.strerror or error}") from error
    keep_file(copy, content)
    keep_file(folder / "labels" / f"{name}.txt", "".join(_lines(photograph, classes)).encode())
    return copy


def _lines(photograph: Photograph, classes: int) -> Iterator[str]:
    for each in photograph.objects:
        kind = LabelKind.BOX_ONLY if each.box_only else LabelKind.OBJECT
        polygon = " ".join(f"{value:.5f}" for value in each.polygon.ravel())
        yield f"{kind.code(each.class_index, classes)} {polygon}\n"
    for unknown in sorted(photograph.unknown):
        yield f"{LabelKind.UNKNOWN_REGION.code(unknown, classes)} {EVERYWHERE}\n"
