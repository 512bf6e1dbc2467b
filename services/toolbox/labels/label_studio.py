"""Labels in Label Studio's form: tasks with predictions, which a labeller accepts or corrects, in JSON. Pure."""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final
from urllib.parse import parse_qs, quote, unquote, urlsplit
from xml.sax.saxutils import quoteattr

import msgspec

from schemas.printing import printable
from services.toolbox.labels.objects import (
    LabelledObject,
    LabelsError,
    PictureLabels,
    box_of,
    decoded,
    file_name,
    object_of,
    size_of,
)

PERCENT: Final = 100.0
UPLOAD: Final = re.compile(r"[0-9a-f]{8}-(?=.)")
"""A name's beginning that Label Studio gives to uploaded files."""


class _Value(msgspec.Struct):
    points: list[tuple[float, float]] = []
    x: float = 0
    y: float = 0
    width: float = 0
    height: float = 0
    rotation: float = 0
    polygonlabels: list[str] = []
    rectanglelabels: list[str] = []


class _Region(msgspec.Struct):
    type: str
    value: _Value = msgspec.field(default_factory=_Value)
    original_width: float | None = None
    original_height: float | None = None
    image_rotation: float = 0


class _Annotation(msgspec.Struct):
    result: list[_Region]
    was_cancelled: bool = False
    updated_at: str = ""


class _Data(msgspec.Struct):
    image: str
    file: str = ""


class _Task(msgspec.Struct):
    data: _Data
    annotations: list[_Annotation] = []
    id: int | str | None = None


def read(content: bytes, where: str) -> Iterator[PictureLabels]:
    """Yield the labels of each task: of its annotations the one that was changed last; none where all were skipped.

    Raises:
        LabelsError: the file is not of this form, or has a region that is no polygon or rectangle.
    """
    for number, task in enumerate(decoded(content, list[_Task], where, "JSON of Label Studio")):
        place = f"{where}: [{number}]" + ("" if task.id is None else f" (task {printable(str(task.id))[:40]})")
        done = [each for each in task.annotations if not each.was_cancelled]
        name = _name(task.data, place)
        if not done:
            yield PictureLabels(name, place, None)
            continue
        regions = max(done, key=lambda each: each.updated_at).result
        sizes = {(each.original_width, each.original_height) for each in regions}
        width, height = next(iter(sizes), (None, None))
        if len(sizes) > 1:
            raise LabelsError(f"{place}: its regions are of pictures of several sizes; export it again")
        size = None if width is None or height is None else size_of(width, height, place)
        yield PictureLabels(name, place, tuple(_object(each, place) for each in regions), size)


def _name(data: _Data, place: str) -> str:
    """Return the picture's name from what we wrote with the task, or from where Label Studio shows it from."""
    if data.file:
        return file_name(data.file, place)
    try:
        address = urlsplit(data.image)
    except ValueError as error:
        raise LabelsError(f"{place}: {data.image[:200]!r} names no picture; export it again") from error
    local = parse_qs(address.query).get("d")
    name = file_name(local[0] if local else unquote(address.path), place)
    return name if local else UPLOAD.sub("", name, count=1)


def _object(region: _Region, place: str) -> LabelledObject:
    value = region.value
    names = {"polygonlabels": value.polygonlabels, "rectanglelabels": value.rectanglelabels}.get(region.type)
    if region.image_rotation:
        raise LabelsError(f"{place}: a region was drawn on a picture that was turned in the tool; redraw it unturned")
    if names is None:
        kind = printable(region.type)[:80]
        raise LabelsError(f"{place}: a region of the type {kind!r} is no polygon or rectangle; delete or redraw it")
    if len(names) != 1:
        raise LabelsError(f"{place}: a region has {len(names)} classes; give it one")
    if region.type == "polygonlabels":
        return object_of(names[0], value.points, (PERCENT, PERCENT), place)
    width, height = region.original_width or 1, region.original_height or 1
    box = (value.x * width, value.y * height, value.width * width, value.height * height)
    size = (width * PERCENT, height * PERCENT)
    return box_of(names[0], box, size, place, turned=value.rotation, at_corner=True)


def local_address(folder: str) -> str:
    """Return the address of local files in a folder of this name, which is in the document root."""
    return f"/data/local-files/?d={quote(folder)}/"


def write(pictures: Iterable[PictureLabels], address: str) -> bytes:
    """Return the tasks of these pictures, whose sizes are known. address: a picture's, but for its path at the end.

    Labels that a person has seen are annotations, others predictions.
    """
    tasks = []
    for picture in pictures:
        task: dict[str, Any] = {"data": {"image": address + quote(picture.path), "file": picture.path}}
        if picture.objects is not None:
            result = [_region(each, picture.size or (0, 0), str(n)) for n, each in enumerate(picture.objects, 1)]
            if picture.by:
                task["predictions"] = [{"model_version": picture.by, "result": result}]
            else:
                task["annotations"] = [{"result": result}]
        tasks.append(task)
    return msgspec.json.encode(tasks)


def _region(labelled: LabelledObject, size: tuple[int, int], number: str) -> dict[str, Any]:
    width, height = size
    about = {"id": number, "to_name": "image", "original_width": width, "original_height": height, "image_rotation": 0}
    points = labelled.polygon * PERCENT
    if not labelled.is_box:
        value = {"points": points.round(5).tolist(), "closed": True, "polygonlabels": [labelled.name]}
        return {**about, "from_name": "polygon", "type": "polygonlabels", "value": value}
    (x, y), (right, bottom) = points.min(axis=0).round(5).tolist(), points.max(axis=0).round(5).tolist()
    value = {"x": x, "y": y, "width": right - x, "height": bottom - y, "rotation": 0}
    value["rectanglelabels"] = [labelled.name]
    return {**about, "from_name": "box", "type": "rectanglelabels", "value": value}


def interface(names: Sequence[str]) -> bytes:
    """Return the labelling interface that a project of these classes needs."""
    labels = "".join(f"    <Label value={quoteattr(name)}/>\n" for name in names)
    return (
        '<View>\n  <Image name="image" value="$image" zoom="true"/>\n'
        f'  <PolygonLabels name="polygon" toName="image">\n{labels}  </PolygonLabels>\n'
        f'  <RectangleLabels name="box" toName="image">\n{labels}  </RectangleLabels>\n</View>\n'
    ).encode()
