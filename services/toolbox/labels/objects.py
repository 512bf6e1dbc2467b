"""Labels of a picture, between the forms of the labelling tools. Pure."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any, Final, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.header import MAX_LABEL
from schemas.image import MAX_SIDE
from schemas.printing import printable
from services.geometry.masks import MAX_PIXELS
from services.geometry.outlines import joined, outline

Points = NDArray[np.float64]
T = TypeVar("T")

CORNERS: Final = 4
FLAT: Final = 1e-9
"""Share of the picture that an object covers at least."""


class LabelsError(Exception):
    """The labels cannot be taken out or in; the message names the file, the place in it, and the cure."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledObject:
    """An object: its class, and its polygon (n, 2) in shares of width and height; of a box the four corners."""

    name: str
    polygon: Points
    is_box: bool = False


@dataclass(frozen=True, slots=True)
class PictureLabels:
    """The labels of a picture.

    name: of its file; of a form that knows no suffixes, without one. place: where in the tool's file, for messages.
    objects: none where somebody saw that there are none; None where nobody labelled it. size: width and height in
    pixels, as far as the tool says. path: in the folder. by: the model that drafted the labels, if no person has seen
    them.
    """

    name: str
    place: str
    objects: tuple[LabelledObject, ...] | None
    size: tuple[int, int] | None = None
    path: str = ""
    by: str = ""


def size_of(width: float, height: float, place: str) -> tuple[int, int]:
    """Return a picture's size.

    Raises:
        LabelsError: no picture of a camera has it.
    """
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise LabelsError(f"{place}: the picture is not 1 to {MAX_SIDE} pixels wide and high; export it again")
    return int(width), int(height)


def object_of(
    name: str, corners: Any, size: tuple[float, float], place: str, *, is_box: bool = False
) -> LabelledObject:
    """Return an object of corners (n, 2) in units of which the picture has `size`, clipped to the picture.

    Raises:
        LabelsError: it has no name, or no area within the picture.
    """
    if not name or len(name) > MAX_LABEL or not name.isprintable():
        raise LabelsError(f"{place}: not the name of a class, which is 1 to {MAX_LABEL} printable characters: {name!r}")
    try:
        points = np.array(corners, np.float64).reshape(-1, 2)
    except (ValueError, OverflowError) as error:
        raise LabelsError(f"{place}: the corners are not pairs of numbers; export it again") from error
    if not np.isfinite(points).all():
        raise LabelsError(f"{place}: a coordinate is not a finite number; export it again")
    polygon = (points / size).clip(0, 1)
    if len(polygon) < 3 or _is_flat(polygon):
        raise LabelsError(
            f"{place}: {printable(name)} has no area within the picture: it needs three corners or more that are not on"
            " a line; delete or redraw it"
        )
    return LabelledObject(name, polygon, is_box)


def _is_flat(polygon: Points) -> bool:
    """Return whether all corners are on a line."""
    across = polygon - polygon[0]
    along = across[np.abs(across).sum(axis=1).argmax()]
    return bool(np.abs(across[:, 0] * along[1] - across[:, 1] * along[0]).max() < FLAT)


def box_of(
    name: str,
    box: Sequence[float],
    size: tuple[float, float],
    place: str,
    *,
    turned: float = 0.0,
    at_corner: bool = False,
) -> LabelledObject:
    """Return an object of a box: left, top, width and height. One that is turned is a polygon.

    turned: degrees by which it is turned, clockwise, around its centre or, with `at_corner`, its left upper corner, in
    units that are the same in both directions.

    Raises:
        LabelsError: it has no area within the picture.
    """
    if len(box) != CORNERS or not all(map(math.isfinite, (*box, turned))):
        raise LabelsError(f"{place}: a box is four finite numbers: left, top, width and height; export it again")
    left, top, width, height = box
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)], np.float64)
    centre = np.zeros(2) if at_corner else np.array([width / 2, height / 2])
    cos, sin = math.cos(math.radians(turned)), math.sin(math.radians(turned))
    corners = (corners - centre) @ np.array([[cos, sin], [-sin, cos]]) + centre + (left, top)
    return object_of(name, corners, size, place, is_box=not turned)


def parts_of(name: str, parts: Sequence[Any], size: tuple[float, float], place: str) -> LabelledObject:
    """Return an object of one or several polygons; several are joined by cuts of no width.

    Raises:
        LabelsError: one has no area within the picture.
    """
    whole = [object_of(name, part, size, place) for part in parts]
    return whole[0] if len(whole) == 1 else LabelledObject(name, joined([part.polygon for part in whole]))


def runs_of(counts: Sequence[int], shape: tuple[int, int], place: str) -> NDArray[np.uint8]:
    """Return the pixels (rows, columns) of a mask, row by row, from the lengths of its alternating clear and set runs.

    Raises:
        LabelsError: they do not fill the mask.
    """
    rows, columns = shape
    if min(counts, default=-1) < 0 or min(shape) < 1 or rows * columns > MAX_PIXELS or sum(counts) != rows * columns:
        raise LabelsError(f"{place}: its runs do not fill a mask of {columns} x {rows} pixels; export it again")
    is_set = np.arange(len(counts), dtype=np.uint8) % 2
    return is_set.repeat(np.array(counts, np.int64)).reshape(shape)


def mask_of(
    name: str, pixels: NDArray[np.uint8], corner: tuple[float, float], size: tuple[int, int], place: str
) -> LabelledObject:
    """Return an object of a mask's pixels, of which the left upper one is at `corner` of the picture.

    Raises:
        LabelsError: the mask is hardly larger than a line.
    """
    around = outline(pixels) if pixels.size else None
    if around is None:
        raise LabelsError(f"{place}: the mask of {printable(name)} is too small; delete or redraw it")
    return object_of(name, np.add(around, (corner[0] + 0.5, corner[1] + 0.5)), size, place)


def file_name(path: str, place: str) -> str:
    """Return a picture's own name from a path as tools write it, which says where it is on a machine of theirs.

    Raises:
        LabelsError: it names no file.
    """
    name = PurePosixPath(path.replace("\\", "/")).name
    if name in ("", "..") or not path.isprintable():
        raise LabelsError(f"{place}: {path[:200]!r} names no picture; export it again")
    return name


def decoded(content: bytes, form: type[T], where: str, tool: str) -> T:
    """Return what a file of JSON says. tool: the name that users know its form by.

    Raises:
        LabelsError: it is no JSON, or not of this form.
    """
    try:
        return msgspec.json.decode(content, type=form)
    except msgspec.ValidationError as error:
        reason, _, path = str(error).partition(" - at `$")
        place = f"{where}: {path.strip('.`')}" if path else where
        raise LabelsError(f"{place}: {reason[:1].lower()}{reason[1:]}; export it again, as {tool}") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        byte = re.search(r"\(byte (\d+)\)", str(error))
        line = content.count(b"\n", 0, int(byte[1])) + 1 if byte else 1
        raise LabelsError(f"{where}, line {line}: not JSON; it may have been cut off: export it again") from error
