"""Labels in COCO's form for instances: polygons, boxes and run-length masks in JSON. Pure."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import msgspec
import numpy as np

from schemas.detections import Mask
from services.geometry.errors import MaskError
from services.geometry.masks import decode
from services.toolbox.labels.objects import (
    LabelledObject,
    LabelsError,
    PictureLabels,
    box_of,
    decoded,
    file_name,
    mask_of,
    parts_of,
    runs_of,
    size_of,
)

DIGITS: Final = 3
"""Decimals of a coordinate in pixels."""

Id = int | str


class _Image(msgspec.Struct):
    id: Id
    file_name: str
    width: int
    height: int


class _Category(msgspec.Struct):
    id: Id
    name: str


class _Runs(msgspec.Struct):
    size: tuple[int, int]
    counts: str | list[int]


class _Annotation(msgspec.Struct):
    image_id: Id
    category_id: Id
    segmentation: list[list[float]] | _Runs | None = None
    bbox: list[float] | None = None


class _File(msgspec.Struct):
    images: list[_Image]
    categories: list[_Category]
    annotations: list[_Annotation]


def read(content: bytes, where: str) -> Iterator[PictureLabels]:
    """Yield the labels of each picture that the file lists.

    Raises:
        LabelsError: the file is not of this form, or an object cannot be read.
    """
    file = decoded(content, _File, where, "COCO instances")
    names = {each.id: each.name for each in file.categories}
    images = {each.id: each for each in file.images}
    if len(images) < len(file.images) or len(names) < len(file.categories):
        raise LabelsError(f"{where}: two images or categories have the same id; export it again")
    objects: dict[Id, list[LabelledObject]] = {each: [] for each in images}
    for number, each in enumerate(file.annotations):
        place = f"{where}: annotations[{number}]"
        if each.image_id not in images or each.category_id not in names:
            raise LabelsError(f"{place}: its image or category is not in the file; export it again")
        objects[each.image_id].append(_object(each, names[each.category_id], images[each.image_id], place))
    for number, image in enumerate(file.images):
        place = f"{where}: images[{number}]"
        name, found = file_name(image.file_name, place), tuple(objects[image.id])
        yield PictureLabels(name, place, found, (image.width, image.height))


def _object(annotation: _Annotation, name: str, image: _Image, place: str) -> LabelledObject:
    size = size_of(image.width, image.height, place)
    match annotation.segmentation:
        case _Runs(counts=counts) as runs:
            if runs.size != (image.height, image.width):
                raise LabelsError(f"{place}: a mask of {runs.size[1]} x {runs.size[0]} pixels is not its image's size")
            return _mask(counts, name, size, place)
        case list() as parts if parts:
            return parts_of(name, parts, size, place)
    if annotation.bbox is None:
        raise LabelsError(f"{place}: it has neither segmentation nor bbox; export it again")
    return box_of(name, annotation.bbox, size, place)


def _mask(counts: str | list[int], name: str, size: tuple[int, int], place: str) -> LabelledObject:
    if not isinstance(counts, str):  # down the columns
        pixels = runs_of(counts, size, place)
        return mask_of(name, np.ascontiguousarray(pixels.T), (0, 0), size, place)
    try:
        window = decode(Mask((size[1], size[0]), counts))
    except MaskError as error:
        raise LabelsError(f"{place}: {error}; export it again") from error
    return mask_of(name, window.pixels.astype(np.uint8), (window.left, window.top), size, place)


def write(pictures: Iterable[PictureLabels], names: Sequence[str]) -> bytes:
    """Return the file of these pictures, whose sizes are known."""
    images, annotations = list[dict[str, Any]](), list[dict[str, Any]]()
    for number, picture in enumerate(pictures, 1):
        width, height = picture.size or (0, 0)
        images.append({"id": number, "file_name": picture.name, "width": width, "height": height})
        for each in picture.objects or ():
            points = each.polygon * (width, height)
            (left, top), (across, down) = points.min(axis=0), np.ptp(points, axis=0)
            x, y = points.T
            area = across * down if each.is_box else abs(x @ np.roll(y, 1) - y @ np.roll(x, 1)) / 2
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": number,
                    "category_id": names.index(each.name) + 1,
                    "segmentation": [] if each.is_box else [points.ravel().round(DIGITS).tolist()],
                    "bbox": [round(float(value), DIGITS) for value in (left, top, across, down)],
                    "area": round(float(area), DIGITS),
                    "iscrowd": 0,
                }
            )
    categories = [{"id": number, "name": name, "supercategory": ""} for number, name in enumerate(names, 1)]
    return msgspec.json.encode({"images": images, "categories": categories, "annotations": annotations})
