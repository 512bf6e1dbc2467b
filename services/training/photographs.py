"""Reads folders of labelled photographs as training and test data.

A folder holds `train` and `val` (or `test`), each with `images/*.jpg` and `labels/*.txt`: one object a line, the number
of its class and its polygon, normalised. A file name up to its first "_" is the picture's source. `data.yaml` names the
classes by number; without it they are the simulated world's (0 box, 1 pallet, 2 forklift). Of a class that it does not
name nobody knows whether the folder's pictures show it. Two optional files say how far the labels go:

- `incomplete.txt`: a line for each source, separated by tabs: `NAME labelled=box absent=forklift unknown=pallet`.
  Objects of an unknown class may be in the pictures without a label, and count neither for nor against a prediction.
- `boxes_only.txt`: pictures whose objects are known as bounding boxes alone; their polygons are those boxes.

A third, `licences.txt`, goes into the model card: a line for each source, its licence and its origin, tabs between.

"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.data_folder import NAMES, SPLITS, DatasetError, Origin, Origins, images_in, labels_of, names_in
from services.simulator.world import CLASSES
from services.training.files import TrainingError

TEST_SPLITS: Final = ("val", "test")
BOX_CORNERS: Final = 4

SourceClasses = tuple[frozenset[int], frozenset[int]]
"""The classes that are in none of a source's pictures, and those that may be there without a label."""


@dataclass(frozen=True, slots=True)
class LabelledObject:
    """One object: its class's index, its polygon (n, 2) in 0..1 of width and height; `box_only` if that is its box."""

    class_index: int
    polygon: NDArray[np.float64]
    box_only: bool = False

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom in 0..1."""
        (left, top), (right, bottom) = self.polygon.min(axis=0), self.polygon.max(axis=0)
        return float(left), float(top), float(right), float(bottom)


@dataclass(frozen=True, slots=True)
class Photograph:
    """A picture's file, its source, its objects, and the indices of classes that its source does not label.

    absent: classes that are in none of the pictures. unknown: classes that may be there without a label. Of all others
    every object has one.
    """

    file: Path
    source: str
    objects: tuple[LabelledObject, ...]
    absent: frozenset[int] = frozenset()
    unknown: frozenset[int] = frozenset()

    @property
    def empty(self) -> bool:
        """Whether none of the classes is in it."""
        return not self.objects and not self.unknown


@dataclass(frozen=True, slots=True)
class PhotographData:
    """The photographs of folders, to train and to test on, their classes, and the licence of each source in words."""

    training: list[Photograph]
    tests: list[Photograph]
    classes: tuple[str, ...]
    licences: dict[str, str]


def read_data(folders: Sequence[Path]) -> PhotographData:
    """Read folders of photographs; without any, the classes are the simulated world's.

    Raises:
        TrainingError: one has nothing to train or to test on, or something there cannot be read.
    """
    classes = classes_of(folders)
    training = [each for folder in folders for each in read_photographs(folder, "train", classes=classes)]
    tests = [each for folder in folders for each in read_photographs(folder, *TEST_SPLITS, classes=classes)]
    for each in tests:
        if not cv2.haveImageReader(str(each.file)):
            raise TrainingError(f"{each.file}: not a picture that can be read")
    licences = {source: text for folder in folders for source, text in read_licences(folder).items()}
    return PhotographData(training, tests, classes, licences)


def classes_of(folders: Sequence[Path]) -> tuple[str, ...]:
    """Return the names of all classes of folders, each once; their places are the classes' indices.

    The simulated world's classes alone are in its own order.

    Raises:
        TrainingError: a data.yaml names one twice.
    """
    named = tuple(dict.fromkeys(name for folder in folders for name in _names(folder)))
    return named if {*named} - {*CLASSES} or 0 < len(named) < len(CLASSES) else CLASSES


def doubts_of(folders: Sequence[Path]) -> Iterator[str]:
    """Yield a line for each folder with pictures whose labels are drafts, as far as it says so, or missing.

    Raises:
        TrainingError: its record cannot be read.
    """
    for folder in folders:
        files = images_in(folder, *SPLITS)
        try:
            origins = Origins(folder)
        except (DatasetError, OSError) as error:
            raise TrainingError(str(error)) from error
        counts = Counter(map(origins.of, files))
        doubts = [f"{counts[Origin.DRAFT]} have drafts of labels that nobody corrected"] * (counts[Origin.DRAFT] > 0)
        doubts += [f"{counts[Origin.NONE]} have no labels and count as empty"] * (counts[Origin.NONE] > 0)
        if doubts:
            yield f"{folder}: of {len(files)} pictures {', '.join(doubts)}; see fleetsight labels check {folder}"


def read_photographs(folder: Path, *splits: str, classes: Sequence[str] | None = None) -> list[Photograph]:
    """Return the photographs of these splits of a folder, in the order of their names.

    classes: in the order of their indices, the folder's own among them; by default `classes_of` the folder.

    Raises:
        TrainingError: the folder has none of the splits or no picture there, or a line of a file cannot be read.
    """
    names = _names(folder)
    classes = classes_of([folder]) if classes is None else classes
    indices = [classes.index(name) for name in names]
    others = frozenset(range(len(classes))).difference(indices)
    known = _source_classes(folder / "incomplete.txt", classes)
    boxes_only = _boxes_only(folder / "boxes_only.txt")
    files = images_in(folder, *splits)
    if not files:
        wanted = " or ".join(f"{split}/images" for split in splits)
        raise TrainingError(f"{folder}: no pictures in {wanted}; name a folder of photographs with labels")
    found = []
    for file in files:
        source = file.name.split("_", 1)[0]
        labels = labels_of(file)
        lines = _objects(labels, indices, box_only=file.name in boxes_only) if labels.exists() else ()
        found.append(Photograph(file, source, tuple(lines), *known.get(source, (frozenset(), others))))
    return found


def _names(folder: Path) -> tuple[str, ...]:
    """Return a folder's classes by number."""
    file = folder / NAMES
    try:
        names = names_in(file)
    except (DatasetError, OSError) as error:
        raise TrainingError(str(error)) from error
    if len({*names}) < len(names):
        raise TrainingError(f"{file}: names a class twice; give each number a name of its own")
    return tuple(names) or CLASSES


def read_licences(folder: Path) -> dict[str, str]:
    """Return each source's licence and origin in words, as far as the folder says.

    Raises:
        TrainingError: a line is no source, licence and origin.
    """
    file = folder / "licences.txt"
    found = {}
    for line in _lines(file) if file.exists() else []:
        if line.strip() and not line.startswith("#"):
            try:
                source, licence, origin = line.split("\t")
            except ValueError as error:
                raise TrainingError(f"{file}: not a source, its licence and its origin: {line[:80]!r}") from error
            found[source.strip()] = f"{licence.strip()}: {origin.strip()}"
    return found


def _objects(labels: Path, indices: Sequence[int], *, box_only: bool) -> Iterator[LabelledObject]:
    """Yield the objects of a file of labels. indices: of the classes, by the numbers that they have there."""
    for number, line in enumerate(_lines(labels), start=1):
        try:
            index, *values = line.split()
            polygon = np.array([float(value) for value in values]).reshape(-1, 2)
            number_of_class = int(index)
        except ValueError as error:
            raise TrainingError(f"{labels}, line {number}: not a class and a polygon of x y pairs") from error
        if number_of_class not in range(len(indices)) or len(polygon) < 2 or not np.isfinite(polygon).all():
            raise TrainingError(f"{labels}, line {number}: not one of {len(indices)} classes with a polygon")
        class_index = indices[number_of_class]
        if len(polygon) == 2:  # class, centre, size: the detection form
            polygon = _corners(*polygon[0], *polygon[1])
            yield LabelledObject(class_index, polygon, box_only=True)
        else:
            yield LabelledObject(class_index, polygon.clip(0, 1), box_only and len(polygon) == BOX_CORNERS)


def _corners(x: float, y: float, width: float, height: float) -> NDArray[np.float64]:
    left, top, right, bottom = x - width / 2, y - height / 2, x + width / 2, y + height / 2
    return np.array([(left, top), (right, top), (right, bottom), (left, bottom)]).clip(0, 1)


def _source_classes(file: Path, classes: Sequence[str]) -> dict[str, SourceClasses]:
    """Return the absent and the unknown classes of each source that has a line."""
    if not file.exists():
        return {}
    return dict(_source(file, line, classes) for line in _lines(file) if line.strip() and not line.startswith("#"))


def _source(file: Path, line: str, classes: Sequence[str]) -> tuple[str, SourceClasses]:
    source, *fields = line.split("\t")
    lists = dict(field.strip().partition("=")[::2] for field in fields)
    names = {key: [name for name in lists.get(key, "").split(",") if name] for key in ("labelled", "absent", "unknown")}
    if unheard := sorted({*names["labelled"], *names["absent"]} - {*classes}):
        raise TrainingError(f"{file}: {source}: no class {unheard[0]!r}; there are {', '.join(classes)}")
    labelled, absent = (frozenset(map(classes.index, names[key])) for key in ("labelled", "absent"))
    return source.strip(), (absent, frozenset(range(len(classes))) - labelled - absent)


def _boxes_only(file: Path) -> frozenset[str]:
    return frozenset(Path(line.strip()).name for line in _lines(file)) if file.exists() else frozenset()


def _lines(file: Path) -> list[str]:
    try:
        return file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise TrainingError(f"{file}: {error}") from error
