"""ObjectClouds: the points of every object in one view, without background."""

from typing import Annotated, Final

import msgspec

from schemas.detections import MAX_DETECTIONS, ClassNumber, Index
from schemas.errors import SchemaError
from schemas.header import Count, Header, Label, Spans
from schemas.space import Coordinate, Length, Vector
from schemas.transforms import Transform

MAX_OBJECT_POINTS: Final = 2_000_000
"""Points in one message, all objects together."""

XYZ_BYTES: Final = 12
RGB_BYTES: Final = 3
HALF_TURN: Final = 3.1416

Angle = Annotated[float, msgspec.Meta(ge=-HALF_TURN, le=HALF_TURN)]


class UprightBox(msgspec.Struct, frozen=True, kw_only=True):
    """The smallest upright box around an object, in one frame of reference.

    size: (length, width, height) in metres. up: unit vector that the height runs along: (0, 0, 1) in a robot's or a
    map's frame, about (0, -1, 0) in a camera's optical frame. yaw: radians from the frame's x axis, made level, to the
    length; counter-clockwise seen from above.
    """

    centre: Vector
    size: tuple[Length, Length, Length]
    yaw: Angle
    up: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 1.0)


class Shape(msgspec.Struct, frozen=True, kw_only=True):
    """An object in one frame of reference. centroid: the middle of its visible surface, metres."""

    centroid: Vector
    box: UprightBox


class ObjectCloud(msgspec.Struct, frozen=True, kw_only=True):
    """One object's visible surface.

    label: the model's own number of the class. index: the object's place in the frame's Detections. track: its track,
    where it has one.
    xyz: 3 little-endian float32 a point: metres in the header's frame. rgb: a byte each of red, green and blue a point,
    or nothing where there is no colour. Both are views into the received payload: decoded without a copy.
    shape: in the header's frame. in_target: in the target frame, if there is one.

    >>> box = UprightBox(centre=(0, 0, 2), size=(0.4, 0.3, 0.2), yaw=0)
    >>> cloud = fleetsight.ObjectCloud(
    ...     name="box", label=0, index=0, xyz=memoryview(np.ones((5, 3), "<f4").tobytes()), rgb=memoryview(b""),
    ...     shape=Shape(centroid=(0, 0, 1.9), box=box),
    ... )
    >>> np.frombuffer(cloud.xyz, "<f4").reshape(-1, 3).shape == (cloud.count, 3)
    True
    """

    name: Label
    label: ClassNumber
    index: Index
    track: Count | None = None
    xyz: memoryview
    rgb: memoryview
    shape: Shape
    in_target: Shape | None = None

    def __post_init__(self) -> None:
        """Check the number of colours against the points.

        Raises:
            SchemaError: no whole number of points, no point at all, or not a colour for each.
        """
        size, colours = self.xyz.nbytes, self.rgb.nbytes
        if not size or size % XYZ_BYTES:
            raise SchemaError(f"{size} bytes are no points of {XYZ_BYTES}")
        if colours and colours != self.count * RGB_BYTES:
            raise SchemaError(f"{colours} bytes of colour, {self.count} points need {self.count * RGB_BYTES}")

    @property
    def count(self) -> int:
        """The number of points."""
        return self.xyz.nbytes // XYZ_BYTES


class ObjectClouds(msgspec.Struct, frozen=True, kw_only=True):
    """The clouds of the objects in one view, best score first, with the worker. An empty list: nothing is in view.

    The header's camera is the one that saw the objects; its frame_id and stamp_ns are those of the points.
    target: where the header's frame is in the chosen target frame at the stamp; without one `unknown_target` says why,
    or is empty where none is chosen.
    unmeasured: why objects of the frame's Detections have no cloud, by their place there.

    >>> found = fleetsight.ObjectClouds(header=header, objects=[], model="my.pt", worker="c1")
    >>> sum(each.count for each in found.objects)  # points
    0
    """

    header: Header
    objects: Annotated[list[ObjectCloud], msgspec.Meta(max_length=MAX_DETECTIONS)]
    model: Label
    worker: Label
    target: Transform | None = None
    unknown_target: Label = ""
    unmeasured: Annotated[dict[Index, Label], msgspec.Meta(max_length=MAX_DETECTIONS)] = {}
    spans: Spans = {}

    def __post_init__(self) -> None:
        """Check the clouds' limits and frames.

        Raises:
            SchemaError: too many points, or shapes in a target frame that there is none of.
        """
        total = sum(each.count for each in self.objects)
        if total > MAX_OBJECT_POINTS:
            raise SchemaError(f"{total} points, at most {MAX_OBJECT_POINTS} are carried")
        if any((each.in_target is None) != (self.target is None) for each in self.objects):
            raise SchemaError("shapes are in a target frame if and only if there is one")
