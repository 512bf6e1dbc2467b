"""Places the objects of views in the map: the edges of their outlines, which are measured, and how well. Pure.

An outline is its support in 12 level directions: the farthest that the object reaches along each. A camera measures the
edges on its own side and to the left and right; those behind the object are not measured.
"""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from schemas.distances import REACHES
from services.geometry.rotation import level_directions
from services.worldmodel.classes import NO_CLASS, Classes
from services.worldmodel.frames import Frames

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

UNITS: Final = level_directions(REACHES)
"""The unit vectors of the directions, (REACHES, 2)."""

HALF: Final = REACHES // 2
_DOUBLED: Final = level_directions(HALF)
"""The unit vectors of the first half of the directions, their angles doubled, (HALF, 2)."""

NOISE_PER_M2: Final = 0.0035
"""Standard deviation of a stereo camera's depth, by the square of the distance."""

BIAS_PER_M2: Final = 0.0043
"""How much nearer noise lets an object's near side seem, by the square of the distance."""

EDGE_M: Final = 0.02
EDGE_PER_M: Final = 0.004
"""Standard deviation of an edge: so many metres, and metres per metre of distance, as masks have pixels."""

HEIGHT_M: Final = 0.015
HEIGHT_PER_M: Final = 0.002
FACING: Final = -0.03
"""Share of the distance by which an edge may lie behind what is seen of its direction and still be measured."""

FLAT_M: Final = 0.1
FLAT_SIGMAS: Final = 2.0
"""Outlines thinner than so many metres, and standard deviations of depth, are of a single face."""

BESIDE: Final = -0.05
"""The cosine between a face's normal and a direction up to which the face's end is the object's."""

BORDER: Final = 0.3
"""Cells from the image's border within which a box may go on outside."""

SIDE: Final = 0.3
CUT_M: Final = 0.25
CUT_SHARE: Final = 0.05
"""Readings beside an object in the image that are nearer by this much are of something that hides a part of it."""

FARTHEST_M: Final = 30.0
HIGHEST_M: Final = 50.0
WIDEST_M: Final = 20.0
TALLEST_M: Final = 20.0
"""How far from the middle of what is seen of an object its lowest and highest point are, at most."""

TOO_FAR: Final = "farther, higher or larger than objects are"
TOO_MANY_CLASSES: Final = "of more classes than there may be"
TOO_MANY_SEEN: Final = "of views of more objects than count"
_NOT_COUNTED: Final = -2
"""Stands for the class of what is left out without being looked at."""

_WHY: Final = {NO_CLASS: TOO_MANY_CLASSES, _NOT_COUNTED: TOO_MANY_SEEN}


@dataclass(slots=True, eq=False)
class Sightings:
    """The n objects of some views, in the map.

    nth: the number of each one among the objects of all views. frame: the number of its view. classes: numbers. edges:
    (n, REACHES) along UNITS, metres. noise: their variance, infinite where an edge is not measured. low, high: heights.
    low_known, high_known: whether those are ends of the object. height_noise: variance of both. middle: (n, 2) of the
    visible surface. away: (n, 2) from the camera. depth: along the optical axis. score: 0 to 1.
    """

    nth: Rows
    frame: Rows
    classes: Rows
    score: Floats
    edges: Floats
    noise: Floats
    low: Floats
    high: Floats
    low_known: Bools
    high_known: Bools
    height_noise: Floats
    middle: Floats
    away: Floats
    depth: Floats

    def __len__(self) -> int:
        return len(self.classes)

    def taken(self, rows: Rows) -> Self:
        """Return some of them."""
        return type(self)(*(getattr(self, name)[rows] for name in self.__slots__))

    def shift(self, offsets: Floats) -> None:
        """Correct all places by their robots' offsets (views, 3): turned at the camera, then moved."""
        x, y, yaw = offsets[self.frame].T
        cos, sin = np.cos(yaw) - 1.0, np.sin(yaw)
        by = np.stack(
            [x + cos * self.away[:, 0] - sin * self.away[:, 1], y + sin * self.away[:, 0] + cos * self.away[:, 1]],
            axis=1,
        )
        self.middle = self.middle + by
        self.edges = self.edges + by @ UNITS.T


def place(frames: Frames, classes: Classes, most_seen: int) -> tuple[Sightings, list[tuple[str, str]]]:
    """Return the sightings of views, and of those that were left out the robots and reasons.

    most_seen: how many objects of a view count.
    """
    table, frame = frames.objects, frames.frame_of
    robots = [view.header.robot for view in frames.views]
    numbers = np.array(
        [
            classes.number(each.name, robot) if nth < most_seen else _NOT_COUNTED
            for view, robot in zip(frames.views, robots, strict=True)
            for nth, each in enumerate(view.objects)
        ],
        np.intp,
    )
    away = table[:, :2] - frames.camera[frame, :2]
    distance = np.sqrt(np.einsum("nk,nk->n", away, away))
    sane = (
        (numbers >= 0)
        & (distance < FARTHEST_M)
        & (np.abs(table[:, 2] - frames.camera[frame, 2]) < HIGHEST_M)
        & (table[:, 11:].max(axis=1, initial=0.0) < WIDEST_M * 1000)
        & (table[:, 5] >= table[:, 4])
        & (np.abs(table[:, 4:6] - table[:, 2:3]) < TALLEST_M).all(axis=1)
        & (table[:, 3] <= FARTHEST_M)
    )
    kept, wrong = np.flatnonzero(sane), np.flatnonzero(~sane)
    reasons = [_WHY.get(number, TOO_FAR) for number in numbers[wrong].tolist()]
    of = [robots[each] for each in frame[wrong].tolist()]
    return _placed(frames, kept, numbers[kept], away[kept]), list(zip(of, reasons, strict=True))


def _placed(frames: Frames, nth: Rows, classes: Rows, away: Floats) -> Sightings:
    table, frame = frames.objects[nth], frames.frame_of[nth]
    reach, depth = table[:, 11:] / 1000, table[:, 3]
    distance = np.maximum(np.sqrt(np.einsum("nk,nk->n", away, away)), 1e-6)
    towards = -away / distance[:, np.newaxis]
    facing = np.maximum(towards @ UNITS.T, 0)
    square = (depth * depth)[:, np.newaxis]
    sigma = (EDGE_M + EDGE_PER_M * depth)[:, np.newaxis]
    noise = sigma * sigma + np.square(NOISE_PER_M2 * square * facing)
    left, right, above, below = _cut(frames, table[:, 7:11], frame, depth)
    noise[_hidden(frames.rotation[frame, :2, 0], reach, towards, distance, depth=depth, left=left, right=right)] = (
        np.inf
    )
    height = HEIGHT_M + HEIGHT_PER_M * depth
    return Sightings(
        nth=nth,
        frame=frame,
        classes=classes,
        score=table[:, 6],
        edges=table[:, :2] @ UNITS.T + reach - BIAS_PER_M2 * square * facing,
        noise=noise,
        low=table[:, 4],
        high=table[:, 5],
        low_known=~below,
        high_known=~above,
        height_noise=height * height,
        middle=table[:, :2],
        away=away,
        depth=depth,
    )


def _hidden(
    to_right: Floats, reach: Floats, towards: Floats, distance: Floats, *, depth: Floats, left: Bools, right: Bools
) -> Bools:
    """Return which edges are not measured: behind the object, beside a single face, or cut off."""
    ahead = (towards @ UNITS.T) * distance[:, np.newaxis] - reach  # as seen from where each edge is
    flat, normal = _faces(reach, towards, depth)
    side = to_right @ UNITS.T
    return np.asarray(
        (ahead < FACING * distance[:, np.newaxis])
        | (flat[:, np.newaxis] & (normal @ UNITS.T < BESIDE))
        | (left[:, np.newaxis] & (side < -SIDE))
        | (right[:, np.newaxis] & (side > SIDE))
    )


def _faces(reach: Floats, towards: Floats, depth: Floats) -> tuple[Bools, Floats]:
    """Return of which objects a single flat face is seen, and its normal, level and towards the camera (n, 2).

    A face's ends do not measure what is behind it. A line's widths are W |cos|, so their squares have one harmonic.
    """
    squares = np.square(reach[:, :HALF] + reach[:, HALF:])
    cos, sin = (squares @ _DOUBLED).T
    thickness = np.sqrt(np.maximum(squares.mean(axis=1) - np.hypot(cos, sin) * 2 / HALF, 0))
    along = np.arctan2(sin, cos) / 2
    normal = np.stack([-np.sin(along), np.cos(along)], axis=1)
    normal *= np.sign(np.einsum("nk,nk->n", normal, towards))[:, np.newaxis]
    return thickness < FLAT_M + FLAT_SIGMAS * NOISE_PER_M2 * depth * depth, normal


def _cut(frames: Frames, box: Floats, frame: Rows, depth: Floats) -> tuple[Bools, ...]:
    """Return which boxes go on beyond what is seen of them at the left, right, top and bottom."""
    limit = (depth - CUT_M - CUT_SHARE * depth) * 1000
    columns, rows = frames.columns[frame], frames.rows[frame]
    x, y = (box[:, 0] + box[:, 2]) / 2, (box[:, 1] + box[:, 3]) / 2
    found = []
    for at_x, at_y, border in (
        (box[:, 0] - 0.5, y, box[:, 0] < BORDER),
        (box[:, 2] + 0.5, y, box[:, 2] > columns - BORDER),
        (x, box[:, 1] - 0.5, box[:, 1] < BORDER),
        (x, box[:, 3] + 0.5, box[:, 3] > rows - BORDER),
    ):
        column = np.clip(at_x, 0, columns - 1).astype(np.intp)
        row = np.clip(at_y, 0, rows - 1).astype(np.intp)
        beside = frames.near_mm[frames.starts[frame] + row * columns + column]
        found.append(border | ((beside > 0) & (beside < limit)))
    return tuple(found)
