"""Labels in CVAT's form for images, version 1.1: polygons, boxes and masks in XML. Pure."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final
from xml.etree.ElementTree import ParseError
from xml.sax.saxutils import escape, quoteattr

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import DefusedXMLParser

from services.toolbox.labels.objects import (
    LabelledObject,
    LabelsError,
    PictureLabels,
    box_of,
    file_name,
    mask_of,
    parts_of,
    runs_of,
    size_of,
)

IMAGE: Final = "image"
SHAPES: Final = ("box", "polygon", "mask")
OTHERS: Final = ("tag", "polyline", "points", "cuboid", "ellipse", "skeleton", "track")
"""Elements that stand for something of which the area is not known."""


def read(content: bytes, where: str) -> Iterator[PictureLabels]:
    """Yield the labels of each picture that the file lists.

    Raises:
        LabelsError: the file is not of this form, or has an object that is no polygon, box or mask.
    """
    target = _Target(where)
    parser = DefusedXMLParser(target=target, forbid_dtd=True)
    target.line = lambda: parser.parser.CurrentLineNumber
    try:
        parser.feed(content)
        parser.close()
    except DefusedXmlException as error:
        raise LabelsError(f"{where}: it declares a document type or entities, as CVAT never does") from error
    except (ParseError, ValueError, LookupError) as error:  # the latter of an unknown encoding
        line, _ = getattr(error, "position", (target.line(), 0))
        raise LabelsError(f"{where}, line {line}: not XML; it may have been cut off: export it again") from error
    yield from target.pictures


class _Target:
    """Takes the elements as they are parsed."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._objects: list[LabelledObject] | None = None
        self._image: tuple[str, str, tuple[int, int]] | None = None
        self._depth = 0
        self.line: Callable[[], int] = lambda: 0
        self.pictures: list[PictureLabels] = []

    def start(self, tag: str, attributes: Mapping[str, str]) -> None:
        place = f"{self._where}, line {self.line()}"
        if self._depth == 0 and tag != "annotations":
            raise LabelsError(f"{place}: a file of <{tag}>, not of CVAT's <annotations>; export 'CVAT for images 1.1'")
        self._depth += 1
        if tag in OTHERS:
            raise LabelsError(f"{place}: a {tag} has no area; delete it in CVAT, or export 'CVAT for images 1.1'")
        try:
            if tag == IMAGE:
                size = size_of(int(attributes["width"]), int(attributes["height"]), place)
                self._image, self._objects = (file_name(attributes["name"], place), place, size), []
            elif tag in SHAPES and self._image is not None and self._objects is not None:
                self._objects.append(_object(tag, attributes, self._image[2], place))
        except (KeyError, ValueError, OverflowError) as error:
            raise LabelsError(f"{place}: a {tag} lacks an attribute, or it is no number; export it again") from error

    def end(self, tag: str) -> None:
        self._depth -= 1
        if tag == IMAGE and self._image is not None and self._objects is not None:
            name, place, size = self._image
            self.pictures.append(PictureLabels(name, place, tuple(self._objects), size))
            self._image = self._objects = None

    def close(self) -> None:
        """The parser asks for it."""


def _object(tag: str, attributes: Mapping[str, str], size: tuple[int, int], place: str) -> LabelledObject:
    name = attributes["label"]
    if tag == "polygon":
        points = [[float(value) for value in point.split(",")] for point in attributes["points"].split(";")]
        return parts_of(name, [points], size, place)
    if tag == "box":
        left, top, right, bottom = (float(attributes[key]) for key in ("xtl", "ytl", "xbr", "ybr"))
        turned = float(attributes.get("rotation", 0))
        return box_of(name, (left, top, right - left, bottom - top), size, place, turned=turned)
    left, top, width, height = (int(attributes[key]) for key in ("left", "top", "width", "height"))
    counts = [int(count) for count in attributes["rle"].split(",")]
    return mask_of(name, runs_of(counts, (height, width), place), (left, top), size, place)


def write(pictures: Iterable[PictureLabels], names: Sequence[str]) -> bytes:
    """Return the file of these pictures, whose sizes are known."""
    lines = ['<?xml version="1.0" encoding="utf-8"?>', "<annotations>", "  <version>1.1</version>"]
    lines += ["  <meta><task><labels>"]
    lines += [f"    <label><name>{escape(name)}</name><attributes></attributes></label>" for name in names]
    lines += ["  </labels></task></meta>"]
    for number, picture in enumerate(pictures):
        width, height = picture.size or (0, 0)
        lines.append(f'  <image id="{number}" name={quoteattr(picture.name)} width="{width}" height="{height}">')
        source = "auto" if picture.by else "manual"
        lines += [f"    {_element(each, (width, height), source)}" for each in picture.objects or ()]
        lines.append("  </image>")
    return "\n".join([*lines, "</annotations>", ""]).encode()


def _element(labelled: LabelledObject, size: tuple[int, int], source: str) -> str:
    points = labelled.polygon * size
    about = f'label={quoteattr(labelled.name)} source="{source}" occluded="0" z_order="0"'
    if labelled.is_box:
        (left, top), (right, bottom) = points.min(axis=0), points.max(axis=0)
        return f'<box {about} xtl="{left:.3f}" ytl="{top:.3f}" xbr="{right:.3f}" ybr="{bottom:.3f}"></box>'
    return f'<polygon {about} points="{";".join(f"{x:.3f},{y:.3f}" for x, y in points)}"></polygon>'
