"""Labels in YOLO's segmentation form: a folder's own, and as tools give it back. Pure."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import PurePosixPath
from typing import Final

import numpy as np

from schemas.printing import printable
from services.toolbox.labels.objects import CORNERS, LabelledObject, LabelsError, PictureLabels, box_of, object_of
from services.yaml_text import YamlError, parse

CLASSES: Final = "classes.txt"
DATA: Final = ("data.yaml", "data.yml", "dataset.yaml")
SHARES: Final = (1.0, 1.0)
MAX_NAMES: Final = 1 << 20
"""Characters of a data.yaml that are read."""


def objects_of(text: str, names: Sequence[str], place: str, *, boxes: bool = False) -> tuple[LabelledObject, ...]:
    """Return the objects of a file of labels. boxes: upright rectangles are boxes.

    Raises:
        LabelsError: a line is no class with a polygon or a box.
    """
    return tuple(
        _object(line.split(), names, f"{place}, line {number}", boxes=boxes)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip()
    )


def _object(words: list[str], names: Sequence[str], place: str, *, boxes: bool) -> LabelledObject:
    try:
        code, values = int(words[0]), [float(word) for word in words[1:]]
    except ValueError as error:
        raise LabelsError(f"{place}: not the number of a class and a polygon or box; correct or remove it") from error
    if not 0 <= code < len(names):
        raise LabelsError(f"{place}: no class has the number {code}; there are {len(names)}: {', '.join(names)[:200]}")
    if len(values) == CORNERS:
        x, y, width, height = values
        return box_of(names[code], (x - width / 2, y - height / 2, width, height), SHARES, place)
    if len(values) % 2:
        raise LabelsError(f"{place}: {len(values)} numbers are no polygon of x and y; correct or remove it")
    is_box = boxes and len(values) == 2 * CORNERS and len({*values[::2]}) == len({*values[1::2]}) == 2  # upright
    return object_of(names[code], values, SHARES, place, is_box=is_box)


def text_of(objects: Sequence[LabelledObject], names: Sequence[str]) -> str:
    """Return the file of a picture's labels, boxes as polygons: Ultralytics takes none beside polygons.

    Beside boxes a polygon of four corners gets a fifth, so that these are told apart where the picture is listed as one
    whose objects of four corners are boxes.
    """
    boxes = any(each.is_box for each in objects)
    return "".join(f"{names.index(each.name)} {_numbers(each, boxes=boxes)}\n" for each in objects)


def _numbers(labelled: LabelledObject, *, boxes: bool) -> str:
    polygon = labelled.polygon
    if boxes and not labelled.is_box and len(polygon) == CORNERS:
        polygon = np.concatenate([polygon, (polygon[:1] + polygon[-1:]) / 2])
    return " ".join(f"{value:.5f}" for value in polygon.ravel())


def is_labels(member: str) -> bool:
    """Return whether a file of a folder or archive has the labels of a picture."""
    path = PurePosixPath(member)
    return path.suffix == ".txt" and "labels" in path.parts[:-1]


def read(members: Sequence[str], text: Callable[[str], str], where: str) -> Iterator[PictureLabels]:
    """Yield the labels that a folder or archive of these files holds; pictures without a file of labels have none.

    text: reads one. where: the folder's or archive's name.

    Raises:
        LabelsError: the classes have no names, or a line cannot be read.
    """
    names = _names(members, text, where)
    for member in sorted(members):
        if is_labels(member):
            place = f"{where}: {printable(member)}"
            yield PictureLabels(PurePosixPath(member).stem, place, objects_of(text(member), names, place))


def _names(members: Sequence[str], text: Callable[[str], str], where: str) -> list[str]:
    for member in members:
        if PurePosixPath(member).name == CLASSES:
            return [line.strip() for line in text(member).splitlines() if line.strip()]
        if PurePosixPath(member).name in DATA:
            try:
                names = parse(text(member)[:MAX_NAMES])[0]["names"]
                return [str(names[code]) for code in range(len(names))]
            except (YamlError, KeyError, TypeError, IndexError) as error:
                raise LabelsError(f"{where}: {member}: it names no classes by number; export it again") from error
    raise LabelsError(f"{printable(where)}: no data.yaml or classes.txt names the classes; add the tool's own")
