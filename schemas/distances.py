"""Distances: the distances and positions of the objects of one image."""

from typing import Annotated, Final

import msgspec

from schemas.detections import MAX_DETECTIONS, Index
from schemas.errors import SchemaError
from schemas.header import Count, Header, Label, Spans
from schemas.space import Distance, Length, Share, Vector

MAX_PLACES: Final = 4


class Place(msgspec.Struct, frozen=True, kw_only=True):
    """The position of an object in one frame of reference at the header's stamp.

    at: metres; absent where that is not known, and then `unknown` says why.
    """

    frame_id: Label
    at: Vector | None = None
    unknown: Label = ""

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
