"""The 3D scene of ObjectClouds for a browser: some coloured points and upright boxes; z is up. Pure."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.objects import ObjectCloud, ObjectClouds, UprightBox
from services.geometry.boxes import axes_of
from services.geometry.rotation import matrix_of, moved

Numbers = NDArray[np.float64]

MOST_POINTS: Final = 6_000
"""Maximum number of points per scene; of more, an even selection is sent."""

FARTHEST_M: Final = 10_000.0
"""Points farther away, or NaN, are left out."""

GREY: Final = 190
FROM_OPTICAL: Final = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotates from the optical frame (x right, y down, z ahead) to x ahead, y left, z up."""

_OPTICAL_UP: Final = -0.5


@dataclass(frozen=True, slots=True)
class SolidBox:
    """A box: size in metres along its own axes; rotation: its columns are these axes."""

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    rotation: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class Solid:
    """One object. xyz: (n, 3) in metres, rgb: (n, 3), 0 to 1. count: the object's points in all.

    distance_m: from the frame's origin to its centroid.
    """

    name: str
    index: int
    xyz: Numbers
    rgb: Numbers
    count: int
    distance_m: float
    box: SolidBox


def solids_of(seen: ObjectClouds, only: int | None = None) -> list[Solid]:
    """Return the objects, in the target frame if known, else in the sensor's, turned upright.

    only: the index of the one object that is wanted; all of them unless given.
    """
    objects = [each for each in seen.objects if only in (None, each.index)]
    total = sum(each.count for each in objects)
    return [_solid(each, seen, min(1.0, MOST_POINTS / total)) for each in objects]


def frame_of(seen: ObjectClouds) -> str:
    """Return the name of the frame in which objects are drawn."""
    return seen.target.frame_id if seen.target else seen.header.frame_id


def _solid(each: ObjectCloud, seen: ObjectClouds, share: float) -> Solid:
    turn = _turn_of(seen, each)
    at = np.linspace(0, each.count - 1, max(1, int(each.count * share))).astype(np.intp)
    points = np.frombuffer(each.xyz, "<f4").reshape(-1, 3)[at].astype(np.float64)
    usable = (np.abs(points) < FARTHEST_M).all(axis=1)
    shape = each.in_target if seen.target and each.in_target else each.shape
    to_shown = np.identity(4) if seen.target and each.in_target else turn
    return Solid(
        name=each.name,
        index=each.index,
        xyz=moved(turn, points[usable]),
        rgb=_colours(each, at[usable]),
        count=each.count,
        distance_m=float(np.linalg.norm(shape.centroid)),
        box=_box(shape.box, to_shown),
    )


def _turn_of(seen: ObjectClouds, each: ObjectCloud) -> Numbers:
    """Return the transform that moves an object's points to where they are drawn."""
    if seen.target is not None:
        rotation = np.array(seen.target.rotation, np.float64)
        length = float(np.linalg.norm(rotation))
        return matrix_of(np.array(seen.target.translation), rotation / length if length else np.array([0, 0, 0, 1.0]))
    made = np.identity(4)
    if each.shape.box.up[1] < _OPTICAL_UP:
        made[:3, :3] = FROM_OPTICAL
    return made


def _colours(each: ObjectCloud, at: NDArray[np.intp]) -> Numbers:
    if not each.rgb.nbytes:
        return np.full((len(at), 3), GREY / 255)
    return np.frombuffer(each.rgb, np.uint8).reshape(-1, 3)[at] / 255


def _box(box: UprightBox, turn: Numbers) -> SolidBox:
    axes = turn[:3, :3] @ axes_of(box).T
    centre = moved(turn, np.array([box.centre]))[0]
    return SolidBox(_three(centre), box.size, tuple(_three(row) for row in axes))


def _three(numbers: Numbers) -> tuple[float, float, float]:
    x, y, z = (round(float(number), 4) for number in numbers)
    return x, y, z


def rounded(numbers: Numbers) -> list[list[float]]:
    """Return numbers rounded to thousandths, as sent to browsers."""
    return np.round(numbers, 3).tolist()  # type: ignore[no-any-return]
