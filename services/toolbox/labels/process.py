"""Takes labels out to a tool's form and back in, and says what came of it."""

import asyncio
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from schemas.printing import printable
from services.data_folder import SPLITS, DatasetError, Origin
from services.toolbox.labels import coco, cvat, label_studio
from services.toolbox.labels.folder import DataFolder, Picture
from services.toolbox.labels.objects import LabelledObject, LabelsError, PictureLabels
from services.toolbox.labels.settings import Form, LabelsSettings
from services.toolbox.labels.source import read_source
from services.whole_file import write_whole

FAILED: Final = 1
SHOWN: Final = 3
"""How many names a line shows at most."""


async def run(settings: LabelsSettings) -> int:
    """Run the task and print what was done; return the exit code: 1 if nothing was labelled or something is wrong.

    Raises:
        LabelsError: the labels cannot be taken out or in.
    """
    try:
        lines, code = await asyncio.to_thread(_TASKS[settings.task], settings)
    except DatasetError as error:
        raise LabelsError(str(error)) from error
    except OSError as error:
        raise LabelsError(f"{printable(str(error.filename or settings.source))}: {error.strerror}") from error
    sys.stdout.writelines(f"{line}\n" for line in lines)
    return code


def _export(settings: LabelsSettings) -> tuple[list[str], int]:
    folder, target = DataFolder(settings.source), settings.target or Path()
    interface = target.with_suffix(".xml") if settings.to == "label-studio" else None
    if interface == target:
        raise LabelsError(f"{printable(str(target))}: the labelling interface gets this name; name a file of .json")
    for file in (target, interface):
        if file is not None and file.exists():
            raise LabelsError(f"{printable(str(file))}: it is there already; remove it, or name another file")
    pictures = list(folder.labels())
    match settings.to:
        case "coco":
            write_whole(target, coco.write(pictures, folder.names))
        case "cvat":
            write_whole(target, cvat.write(pictures, folder.names))
        case _:
            address = settings.image_url or label_studio.local_address(folder.folder.resolve().name)
            write_whole(target, label_studio.write(pictures, address))
    lines = [f"{printable(str(target))}: {_count(len(pictures), 'picture')}, {_per_class(folder.names, pictures)}"]
    lines += _origins(folder, set())
    if interface is not None:
        write_whole(interface, label_studio.interface(folder.names))
        lines.append(f"{printable(str(interface))}: the labelling interface for the project's settings")
    return lines, 0


def _import(settings: LabelsSettings) -> tuple[list[str], int]:
    folder = DataFolder(settings.target or Path())
    known = len(folder.names)
    if settings.source.is_dir() and settings.source.samefile(folder.folder):
        form, given = Form.YOLO, [each for each in folder.labels() if each.objects is not None]
    else:
        form, given = read_source(settings.source, settings.form)
    found, left, unknown = _matched(folder, given, leave_empty=settings.leave_empty)
    if given and len(unknown) == len(given):
        raise LabelsError(
            f"{printable(str(settings.source))}: none of its pictures is in {folder.where}, such as {unknown[0]}; name"
            " the folder that was exported"
        )
    as_before = folder.replace(found, {"by": str(form), "from": settings.source.name})
    labels = [PictureLabels("", "", objects) for _, objects in found]
    lines = [f"{folder.where}: {_count(len(found), 'picture')} labelled, {_per_class(folder.names, labels)}"]
    if empty := sum(not objects for _, objects in found):
        lines.append(f"{_count(empty, 'picture')} of them without objects")
    if as_before:
        lines.append(f"{_count(as_before, 'picture')} of them as before")
    if left:
        lines.append(f"{_count(left, 'picture')} left as before: the file has no labels of a person for them")
    lines += _origins(folder, {picture.path for picture, _ in found})
    if unknown:
        lines.append(f"{_count(len(unknown), 'picture')} of the file not in the folder: {_some(unknown)}")
    if new := folder.names[known:]:
        lines.append(f"new in data.yaml: {_some(new)}")
    return lines, 0 if found else FAILED


def _check(settings: LabelsSettings) -> tuple[list[str], int]:
    folder = DataFolder(settings.source)
    read, mistakes = list[PictureLabels](), list[str]()
    for picture in folder.pictures.values():
        try:
            read.append(PictureLabels(picture.path, "", folder.objects(picture), picture.size))
        except LabelsError as error:
            mistakes.append(str(error))
    lines = [f"{folder.where}: {_count(len(folder.pictures), 'picture')}"]
    for split in SPLITS:
        count = sum(each.path.startswith(f"{split}/") for each in folder.pictures.values())
        some = [each for each in read if each.name.startswith(f"{split}/")]
        lines.append(f"{split}: {_count(count, 'picture')}, {_per_class(folder.names, some)}")
    by_origin = {origin: list[str]() for origin in Origin}
    for picture in folder.pictures.values():
        by_origin[folder.origins.of(picture.file)].append(picture.path)
    lines += [f"{len(by_origin[origin])} {origin}" for origin in (Origin.PERSON, Origin.UNKNOWN) if by_origin[origin]]
    faults = {origin: by_origin[origin] for origin in (Origin.DRAFT, Origin.NONE)}
    lines += [f"{len(paths)} {origin}: {_some(paths)}" for origin, paths in faults.items() if paths]
    if lost := folder.lost_labels():
        lines.append(f"{_count(len(lost), 'file')} of labels without a picture: {_some(lost)}")
    return [*lines, *mistakes], FAILED if mistakes or lost or any(faults.values()) else 0


def _matched(
    folder: DataFolder, given: Sequence[PictureLabels], *, leave_empty: bool
) -> tuple[list[tuple[Picture, tuple[LabelledObject, ...]]], int, list[str]]:
    """Return the pictures with their new labels, how many are left as they are, and the names of unknown ones.

    Raises:
        LabelsError: a picture is in the file twice, or has another size there.
    """
    found, left, unknown, places = [], 0, [], dict[str, str]()
    for labels in given:
        picture = folder.find(labels)
        if picture is None:
            unknown.append(printable(labels.name))
            continue
        if other := places.get(picture.path):
            raise LabelsError(
                f"{labels.place}: {picture.path} is there twice, first at {other}; remove one in the tool"
            )
        places[picture.path] = labels.place
        if labels.objects is None or (leave_empty and not labels.objects):
            left += 1
        else:
            found.append((picture, labels.objects))
    return found, left, unknown


def _origins(folder: DataFolder, labelled: set[str]) -> Iterator[str]:
    """Yield a line that counts the other pictures by the origin of their labels."""
    others = [picture for picture in folder.pictures.values() if picture.path not in labelled]
    counts = Counter(folder.origins.of(picture.file) for picture in others)
    if others:
        yield f"{'others' if labelled else 'pictures'}: " + ", ".join(
            f"{counts[origin]} {origin}" for origin in Origin if counts[origin]
        )


def _per_class(names: Sequence[str], pictures: Sequence[PictureLabels]) -> str:
    counts = Counter(each.name for picture in pictures for each in picture.objects or ())
    total = _count(counts.total(), "object")
    return f"{total} ({', '.join(f'{counts[name]} {printable(name)}' for name in names)})"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _some(names: Sequence[str]) -> str:
    shown = ", ".join(map(printable, names[:SHOWN]))
    return shown if len(names) <= SHOWN else f"{shown} and {len(names) - SHOWN} more"


_TASKS: Final[Mapping[str, Callable[[LabelsSettings], tuple[list[str], int]]]] = {
    "export": _export,
    "import": _import,
    "check": _check,
}
