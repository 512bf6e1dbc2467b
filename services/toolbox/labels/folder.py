"""The data-set folder: its pictures, and the labels that these have and get."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from PIL import Image

from schemas.printing import printable
from services.data_folder import (
    LABELLED,
    NAMES,
    SPLITS,
    Origin,
    Origins,
    cut_torn,
    images_in,
    labels_of,
    names_in,
    write_names,
)
from services.toolbox.labels import yolo
from services.toolbox.labels.objects import LabelledObject, LabelsError, PictureLabels
from services.whole_file import write_whole

BOXES: Final = "boxes_only.txt"
TURNED: Final = 5
"""The least orientation in EXIF that swaps width and height."""

ORIENTATION: Final = 0x0112
UNREADABLE: Final = (OSError, ValueError, SyntaxError, TypeError, ImportError, Image.DecompressionBombError)
"""Raised by Pillow for what it cannot read; where Ultralytics is loaded, it first misses a plug-in for HEIF."""

SAME: Final = 5e-5
"""Difference of two coordinates that comes of rounding in the forms."""


@dataclass(frozen=True)
class Picture:
    """A picture of the folder. path: in the folder."""

    file: Path
    path: str

    @cached_property
    def size(self) -> tuple[int, int]:
        """Its width and height in pixels as it is shown: turned as its EXIF data say.

        Raises:
            LabelsError: it cannot be read.
        """
        try:
            with Image.open(self.file) as image:
                turned = image.getexif().get(ORIENTATION, 1) >= TURNED
                width, height = image.size
        except UNREADABLE as error:
            raise LabelsError(f"{printable(str(self.file))}: not a picture that can be read; remove it") from error
        return (height, width) if turned else (width, height)


class DataFolder:
    """A folder with pictures. names: of the classes, in the order of their numbers. pictures: by their files' names."""

    def __init__(self, folder: Path) -> None:
        """Read the folder.

        Raises:
            LabelsError: it has no pictures, two of the same name, or nothing that names the classes.
            DatasetError: a record in it is damaged.
            OSError: it cannot be read.
        """
        self.folder = folder
        self.where = printable(str(folder))
        files = images_in(folder, *SPLITS)
        if not files:
            wanted = " or ".join(f"{split}/images" for split in SPLITS)
            raise LabelsError(f"{self.where}: no pictures in {wanted}; name a folder as `fleetsight collect` makes it")
        self.names = names_in(folder / NAMES)
        if not self.names:
            example = "names: {0: box, 1: pallet, 2: forklift}"
            raise LabelsError(f"{self.where}: no {NAMES} names the classes; write one, such as {example}")
        if odd := next((name for name in self.names if self.names.count(name) > 1 or not name.isprintable()), None):
            raise LabelsError(
                f"{self.where}: {NAMES}: other tools know classes by name, which {odd!r} is not; rename it"
            )
        self.pictures: dict[str, Picture] = {}
        self._stems: dict[str, Picture] = {}
        for file in files:
            self._add(Picture(file, file.relative_to(folder).as_posix()))
        self.origins = Origins(folder)
        boxes = folder / BOXES
        try:
            self._boxes = boxes.read_text(encoding="utf-8").splitlines() if boxes.exists() else []
        except UnicodeDecodeError as error:
            raise LabelsError(f"{printable(str(boxes))}: not UTF-8; save it as UTF-8, or remove it") from error
        self._known_boxes = {Path(line.strip()).name for line in self._boxes}

    def _add(self, picture: Picture) -> None:
        if not picture.path.isprintable():
            raise LabelsError(f"{self.where}: {printable(picture.path)}: other tools cannot take this name; rename it")
        if other := self._stems.get(picture.file.stem):
            both = f"{other.path} and {picture.path}"
            raise LabelsError(f"{self.where}: {both} have the same name, and tools go by names; rename one")
        self.pictures[picture.file.name] = self._stems[picture.file.stem] = picture

    def find(self, labels: PictureLabels) -> Picture | None:
        """Return the picture that labels are of, if it is here.

        Raises:
            LabelsError: it has another size than the tool saw.
        """
        picture = self.pictures.get(labels.name) or self._stems.get(labels.name)
        if picture is None or labels.size is None or labels.size == picture.size:
            return picture
        (width, height), (wide, high) = labels.size, picture.size
        turned = "the tool does not turn pictures as their EXIF data say; " if (width, height) == (high, wide) else ""
        raise LabelsError(
            f"{labels.place}: the labels are of a picture of {width} x {height} pixels, but {picture.path} has {wide} x"
            f" {high}: {turned}label the picture that is in the folder"
        )

    def labels(self) -> Iterator[PictureLabels]:
        """Yield the labels of each picture, and its size.

        Raises:
            LabelsError: a picture or a line of its labels cannot be read.
        """
        for name, picture in self.pictures.items():
            objects = self.objects(picture)
            drafted = self.origins.of(picture.file) in (Origin.DRAFT, Origin.UNKNOWN)
            by = self.origins.drafts_by.get(picture.path, "unknown") if drafted else ""
            yield PictureLabels(name, picture.path, objects, picture.size, picture.path, by)

    def lost_labels(self) -> list[str]:
        """Return the files of labels, in the folder, that belong to no picture."""
        own = {labels_of(picture.file) for picture in self.pictures.values()}
        files = (file for split in SPLITS for file in sorted((self.folder / split / "labels").glob("*.txt")))
        return [file.relative_to(self.folder).as_posix() for file in files if file not in own]

    def objects(self, picture: Picture) -> tuple[LabelledObject, ...] | None:
        """Return the objects that a picture's labels tell of, None where it has no labels.

        Raises:
            LabelsError: a line cannot be read.
        """
        file = labels_of(picture.file)
        place = printable(str(file))
        try:
            text = file.read_text(encoding="utf-8") if file.exists() else None
        except UnicodeDecodeError as error:
            raise LabelsError(f"{place}: not UTF-8; remove it, or label its picture again") from error
        if text is None:
            return None
        return yolo.objects_of(text, self.names, place, boxes=picture.file.name in self._known_boxes)

    def replace(self, found: Iterable[tuple[Picture, tuple[LabelledObject, ...]]], about: dict[str, Any]) -> int:
        """Replace the labels of pictures by those that a person has seen; return how many are as they were before.

        Each file is replaced whole, and has a line in the record from then on. about: what that says of the import.

        Raises:
            OSError: a file cannot be written.
        """
        found = list(found)
        self._learn(each.name for _, objects in found for each in objects)
        as_before = [self._is_as_before(*each) for each in found]
        self._note_boxes([each for each, same in zip(found, as_before, strict=True) if not same])
        cut_torn(self.folder / LABELLED)
        at = datetime.now(UTC).isoformat(timespec="seconds")
        with (self.folder / LABELLED).open("a", encoding="utf-8") as record:
            for (picture, objects), same in zip(found, as_before, strict=True):
                if not same:
                    write_whole(labels_of(picture.file), yolo.text_of(objects, self.names).encode())
                line = {"file": picture.path, "at": at, **about, "objects": len(objects), "as_before": same}
                record.write(json.dumps(line) + "\n")
                record.flush()
        return sum(as_before)

    def _is_as_before(self, picture: Picture, objects: tuple[LabelledObject, ...]) -> bool:
        try:
            before = self.objects(picture)
        except LabelsError:  # to be replaced
            return False
        return before is not None and len(before) == len(objects) and all(map(_is_same, before, objects))

    def _learn(self, names: Iterable[str]) -> None:
        new = [name for name in dict.fromkeys(names) if name not in self.names]
        if new:
            self.names += new
            content = yaml.safe_load((self.folder / NAMES).read_text(encoding="utf-8"))
            others = {key: content[key] for key in content if key != "names"}
            write_names(self.folder / NAMES, self.names, **others | ({"nc": len(self.names)} if "nc" in others else {}))

    def _note_boxes(self, found: list[tuple[Picture, tuple[LabelledObject, ...]]]) -> None:
        """Write which pictures have boxes for objects, before their labels say so."""
        boxes = {picture.file.name: any(each.is_box for each in objects) for picture, objects in found}
        kept = [line for line in self._boxes if boxes.get(Path(line.strip()).name, True)]
        new = [picture.path for picture, _ in found if boxes[picture.file.name]]
        lines = [*kept, *(path for path in new if Path(path).name not in self._known_boxes)]
        if lines != self._boxes:
            write_whole(self.folder / BOXES, "".join(f"{line}\n" for line in lines).encode())


def _is_same(one: LabelledObject, other: LabelledObject) -> bool:
    if (one.name, one.is_box, one.polygon.shape) != (other.name, other.is_box, other.polygon.shape):
        return False
    return bool(np.allclose(one.polygon, other.polygon, rtol=0, atol=SAME))
