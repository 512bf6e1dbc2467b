"""Distances: the distances and positions of the objects of one image. CameraView: the same for a model of the world."""

import math
from typing import Annotated, Final

import msgspec

from schemas.detections import MAX_DETECTIONS, MAX_KEYPOINTS, Index
from schemas.errors import SchemaError
from schemas.header import Count, Header, Label, Spans
from schemas.space import Coordinate, Distance, Length, Share, Vector

MAX_PLACES: Final = 4


class Place(msgspec.Struct, frozen=True, kw_only=True):
    """The position of an object in one frame of reference at the header's stamp.

    at: metres; absent where that is not known, and then `unknown` says why. keypoints: the same of each of its
    detection's keypoints, None of those that are not in view or have no reading near the object's; none without `at`.
    """

    frame_id: Label
    at: Vector | None = None
    unknown: Label = ""
    keypoints: Annotated[list[Vector | None], msgspec.Meta(max_length=MAX_KEYPOINTS)] = []

    def __post_init__(self) -> None:
        """Check that the place is either known or unknown.

        Raises:
            SchemaError: it is both, or neither.
        """
        check_known(f"place in {self.frame_id[:64]}", known=self.at is not None, unknown=self.unknown)


class Measured(msgspec.Struct, frozen=True, kw_only=True):
    """The depth of one object's foreground, in metres.

    axial_m: robust distance along the camera's optical axis, as depth images have it.
    euclidean_m: robust straight distance from the camera's optical centre; absent without a calibration.
    mean_m: mean along the optical axis over every valid pixel of the mask, background that shows through included.
    nearest_m: along the optical axis. spread_m: robust standard deviation along the optical axis.
    places: the object's foreground in the camera's optical frame first, then in each further frame that is asked for.

    >>> fleetsight.Measured(axial_m=2.4, euclidean_m=2.5, mean_m=2.6, nearest_m=2.2, spread_m=0.1).nearest_m
    2.2
    """

    axial_m: Distance
    euclidean_m: Distance | None = None
    mean_m: Distance
    nearest_m: Distance
    spread_m: Length
    places: Annotated[list[Place], msgspec.Meta(max_length=MAX_PLACES)] = []


class ObjectDistance(msgspec.Struct, frozen=True, kw_only=True):
    """One object of the image, with its distance.

    index: its place in the frame's Detections. track: its track, where it has one.
    valid_share: pixels of its mask that have a usable reading, 0 to 1.
    measured: absent where its distance is not known, and then `unknown` says why.

    >>> distance = fleetsight.ObjectDistance(name="box", index=0, valid_share=0.0, unknown="no depth")
    >>> distance.unknown if distance.measured is None else f"{distance.measured.axial_m} m"
    'no depth'
    """

    name: Label
    index: Index
    track: Count | None = None
    valid_share: Share
    measured: Measured | None = None
    unknown: Label = ""

    def __post_init__(self) -> None:
        """Check that the distance is either known or unknown.

        Raises:
            SchemaError: it is both, or neither.
        """
        check_known(f"distance of {self.name[:64]}", known=self.measured is not None, unknown=self.unknown)


class Distances(msgspec.Struct, frozen=True, kw_only=True):
    """The distances of the objects in one colour image, in the order of its Detections, with the worker.

    The header is that image's. model: the one that detected the objects. worker: the one that measured them.

    >>> measured = fleetsight.Measured(axial_m=2.4, mean_m=2.6, nearest_m=2.2, spread_m=0.1)
    >>> box = fleetsight.ObjectDistance(name="box", index=0, valid_share=0.9, measured=measured)
    >>> found = fleetsight.Distances(header=header, objects=[box], model="my.pt", worker="d1")
    >>> min(each.measured.nearest_m for each in found.objects if each.measured)
    2.2
    """

    header: Header
    objects: Annotated[list[ObjectDistance], msgspec.Meta(max_length=MAX_DETECTIONS)]
    model: Label
    worker: Label
    spans: Spans = {}


def check_known(what: str, *, known: bool, unknown: str) -> None:
    """Raise SchemaError unless exactly one is given: the value, or the reason why it is unknown."""
    if known == bool(unknown):
        raise SchemaError(f"{what} is {'known, and unknown' if known else 'neither known nor unknown'}")


REACHES: Final = 12
"""Directions in which the reach of an object is given, 30 degrees apart."""

MAX_GRID: Final = 16_384
Millimetres = Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)]
Cells = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]

UNIT: Final = 0.01
"""How far the length of a view's rotation may be from 1."""


class ViewedObject(msgspec.Struct, frozen=True, kw_only=True):
    """One object of a view that has depth: the part of its surface that is seen.

    name, score, index, track: of its detection. box: left, top, right and bottom in cells of the view's grid.
    depth_m: robust distance along the optical axis. spread_m: robust standard deviation of it.
    at: the middle of its visible surface in the view's frame, metres. reach_mm: how far the surface reaches from there
    in REACHES level directions, the first along the frame's x axis, the others counter-clockwise. low_m, high_m: the
    height of its lowest and highest reading in the frame.
    """

    name: Label
    score: Share
    index: Index
    track: Count | None = None
    box: tuple[Cells, Cells, Cells, Cells]
    depth_m: Distance
    spread_m: Length
    at: Vector
    reach_mm: Annotated[list[Millimetres], msgspec.Meta(min_length=REACHES, max_length=REACHES)]
    low_m: Coordinate
    high_m: Coordinate


class DepthGrid(msgspec.Struct, frozen=True, kw_only=True):
    """How far a camera sees, coarsely: columns x rows cells of a pinhole camera's image, row by row from the top left.

    fx, fy, cx, cy: the pinhole's, in cells, (0, 0) being the upper left corner of the first one: a point (x, y, z) of
    the optical frame is in column floor(fx * x / z + cx). near_mm, far_mm: a little-endian uint16 a cell each:
    millimetres along the optical axis, so that four fifths of the cell's readings are farther than `near_mm`, and four
    fifths nearer than `far_mm`; 0 where less than half of the cell has a reading. Views into the received payload.
    """

    columns: Annotated[int, msgspec.Meta(ge=1, le=MAX_GRID)]
    rows: Annotated[int, msgspec.Meta(ge=1, le=MAX_GRID)]
    fx: Annotated[float, msgspec.Meta(gt=0, le=1e6)]
    fy: Annotated[float, msgspec.Meta(gt=0, le=1e6)]
    cx: Cells
    cy: Cells
    near_mm: memoryview
    far_mm: memoryview

    def __post_init__(self) -> None:
        """Check the number of cells.

        Raises:
            SchemaError: there are too many, or not as many depths.
        """
        count = self.columns * self.rows
        if count > MAX_GRID:
            raise SchemaError(f"a grid of {count} cells, at most {MAX_GRID} are carried")
        if (self.near_mm.nbytes, self.far_mm.nbytes) != (2 * count, 2 * count):
            raise SchemaError(f"{self.near_mm.nbytes} and {self.far_mm.nbytes} bytes for {count} cells")


class CameraView(msgspec.Struct, frozen=True, kw_only=True):
    """The objects of one colour image in a frame that does not move, and how far the camera saw: a few kilobytes.

    The header is that image's. frame_id: the frame of all positions, such as `map`. position, rotation: the camera's
    optical frame there at the stamp, metres and a unit quaternion x, y, z, w. speed, turn: how fast the camera moved,
    metres and radians a second. unlocated: why that is not known, in words, and then there are no objects. grid: None
    where there is no depth of the instant, and then `unseen` says why. objects: those with depth.
    unmeasured: how many others were detected, by class.
    """

    header: Header
    frame_id: Label
    position: Vector | None = None
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    speed: Length = 0.0
    turn: Length = 0.0
    unlocated: Label = ""
    grid: DepthGrid | None = None
    unseen: Label = ""
    objects: Annotated[list[ViewedObject], msgspec.Meta(max_length=MAX_DETECTIONS)] = []
    unmeasured: Annotated[dict[Label, Count], msgspec.Meta(max_length=MAX_DETECTIONS)] = {}
    model: Label
    worker: Label
    spans: Spans = {}

    def __post_init__(self) -> None:
        """Check that the place is either known or unknown, that objects have one, and that the rotation is one.

        Raises:
            SchemaError: it is both, or neither, objects have positions in a frame that is unknown, or the rotation is
                not finite or not of length 1.
        """
        check_known(f"view in {self.frame_id[:64]}", known=self.position is not None, unknown=self.unlocated)
        if self.position is None and self.objects:
            raise SchemaError(f"{len(self.objects)} objects in a frame that is unknown")
        length = math.hypot(*self.rotation)
        if not abs(length - 1) <= UNIT:  # so is NaN
            raise SchemaError(f"a rotation of length {length:g} instead of 1")
