"""The world: the objects of a site, each once, from all robots, and how they change.

A site is one map: a hall, or one floor of it. Ids of objects and positions are a site's own.
"""

from enum import StrEnum
from typing import Annotated, Final

import msgspec

from schemas.errors import SchemaError
from schemas.header import Count, Label, MaybeName, Name, Nanoseconds
from schemas.space import Coordinate, Length, Share, Vector
from schemas.status import Drops

MAX_OBJECTS: Final = 20_000
"""Maximum number of objects in one answer; query class by class or region by region for more."""

MAX_CHANGES: Final = 4_096
MAX_SEERS: Final = 16
MAX_CORNERS: Final = 256
MAX_ROBOTS: Final = 4_096
MAX_ROBOT_CAMERAS: Final = 32
MAX_PROBLEMS: Final = 16
MAX_CELLS: Final = 1_000_000
LONG_AGO: Final = 65_535
"""Age in seconds of floor that was looked at longer ago or never."""


HALF_TURN: Final = 3.1416

Yaw = Annotated[float, msgspec.Meta(ge=-HALF_TURN, le=HALF_TURN)]
WorldId = Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
Epoch = Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
"""One run of a site's model: numbers of changes of different epochs cannot be compared. Ids of objects outlive it."""

Covariance = tuple[Coordinate, Coordinate, Coordinate, Coordinate, Coordinate, Coordinate]
"""Upper triangle of a 3 x 3 matrix, row by row (xx, xy, xz, yy, yz, zz), in square metres."""

Point = tuple[Coordinate, Coordinate]
"""x, y in the site's map, in metres."""


class Seer(msgspec.Struct, frozen=True, kw_only=True):
    """A camera that saw an object, and when last."""

    robot: Name
    camera: Name
    last_ns: Nanoseconds


class WorldObject(msgspec.Struct, frozen=True, kw_only=True):
    """One object of a site. Times are nanoseconds since the epoch on the model's clock.

    id: the same for as long as the object is known, and never given to another one. name: its class.
    at: the centre of its box in the site's map, metres. covariance: of `at`.
    size: (length, width, height) of its upright box in metres. yaw: radians from the map's x axis to the length,
    counter-clockwise seen from above; None where that is not known, and then length and width are those of a box along
    the map's axes.
    existence: the probability that it is there. first_ns, last_ns: when it was seen first and last.
    looked_ns: when its place was last looked at without the object being seen; 0 for never since it was seen.
    seen_by: the cameras that saw it, the latest first. sightings: how often it was seen.
    velocity: metres a second along x and y; None where its class stands still.

    >>> pallet = fleetsight.WorldObject(
    ...     id="e1-17", site="main", name="pallet", at=(3.2, -1.0, 0.07), covariance=(0.01, 0, 0, 0.01, 0, 0.01),
    ...     size=(1.2, 0.8, 0.14), existence=0.98, first_ns=10**18, last_ns=10**18,
    ... )
    >>> pallet.covariance[0] ** 0.5  # standard deviation along x, metres
    0.1
    """

    id: WorldId
    site: Name
    name: Label
    at: Vector
    covariance: Covariance
    size: tuple[Length, Length, Length]
    yaw: Yaw | None = None
    existence: Share
    first_ns: Nanoseconds
    last_ns: Nanoseconds
    looked_ns: Nanoseconds = 0
    seen_by: Annotated[list[Seer], msgspec.Meta(max_length=MAX_SEERS)] = []
    sightings: Count = 1
    velocity: tuple[Coordinate, Coordinate] | None = None


class ChangeKind(StrEnum):
    """How an object changed.

    APPEARED: it is new. MOVED: it is at another place than it was when that was last told. GONE: somebody looked at its
    place and it was not there. BACK: it is there after all, with its old id. MERGED: it turned out to be another known
    object, see `WorldChange.into`. SEEN: nothing happened, but its estimate or its times are newer.
    """

    APPEARED = "appeared"
    MOVED = "moved"
    GONE = "gone"
    BACK = "back"
    MERGED = "merged"
    SEEN = "seen"


class WorldChange(msgspec.Struct, frozen=True, kw_only=True):
    """One change. at_ns: when what shows it was seen. object: as it is now; of GONE and MERGED, as it was last.

    before: where it was, for MOVED. into: the id that it goes by from now on, for MERGED. by: the robot that saw it.
    """

    kind: ChangeKind
    at_ns: Nanoseconds
    object: WorldObject
    before: Vector | None = None
    into: WorldId | None = None
    by: MaybeName = ""

    def __post_init__(self) -> None:
        """Check that `into` goes with MERGED alone.

        Raises:
            SchemaError: it is missing there, or given elsewhere.
        """
        if (self.into is not None) != (self.kind is ChangeKind.MERGED):
            raise SchemaError(f"a change {self.kind} {'with' if self.into else 'without'} an object to merge into")


class WorldChanges(msgspec.Struct, frozen=True, kw_only=True):
    """Some changes of a site, in order. They are numbered from 1 on: the first of these is `first`.

    A subscriber that joins late, misses a number or meets a new epoch requests all objects (WorldRequest): the answer
    has the epoch and the number of the last change in it, and changes with higher numbers are applied to it.
    """

    site: Name
    epoch: Epoch
    first: Count
    sent_ns: Nanoseconds
    changes: Annotated[list[WorldChange], msgspec.Meta(max_length=MAX_CHANGES)]


class WorldRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A query for the objects of a site; each field narrows it down. A field that is not known is an error.

    name: of the class. region: corners of a polygon in the map that the object's centre is in. robot: objects that it
    saw. seen_within_s: seen at most so long ago. unseen_for_s: not seen for at least so long. least_existence: with at
    least this probability; those that the model has not confirmed are never in the answer.
    """

    name: Label = ""
    region: Annotated[list[Point], msgspec.Meta(max_length=MAX_CORNERS)] = []
    robot: MaybeName = ""
    seen_within_s: Annotated[float, msgspec.Meta(ge=0)] | None = None
    unseen_for_s: Annotated[float, msgspec.Meta(ge=0)] | None = None
    least_existence: Share = 0.0


class WorldAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """The objects that were asked for, as of now_ns, by class and id. complete: False if more do not fit.

    epoch, last: the number of the last change that is in it, see WorldChanges.

    >>> answer = fleetsight.WorldAnswer(site="main", epoch="e1", last=0, now_ns=10**18, objects=[])
    >>> [each.id for each in answer.objects if each.existence > 0.9]
    []
    """

    site: Name
    epoch: Epoch
    last: Count
    now_ns: Nanoseconds
    objects: Annotated[list[WorldObject], msgspec.Meta(max_length=MAX_OBJECTS)]
    complete: bool = True


class NearbyObjects(msgspec.Struct, frozen=True, kw_only=True):
    """The fresh objects near a robot, seen by any robot, nearest first; sent to the robot while it listens.

    frame_id: of all positions, the robot's own name for the site's map, such as `map`.
    """

    robot: Name
    site: Name
    frame_id: Label
    sent_ns: Nanoseconds
    radius_m: Length
    objects: Annotated[list[WorldObject], msgspec.Meta(max_length=MAX_CHANGES)]


class RobotOffset(msgspec.Struct, frozen=True, kw_only=True):
    """How far a robot's localisation is off, as what all robots see shows it: add it to the robot's pose.

    x, y: metres. yaw: radians, turned at the robot. sigma_m: of x and y. doubted: why what the robot says is left out
    for now, in words; empty while it counts. views: how many of its views came. last_ns: when the last one did.
    """

    robot: Name
    x: Coordinate
    y: Coordinate
    yaw: Yaw
    sigma_m: Length
    doubted: Label = ""
    views: Count
    last_ns: Nanoseconds


class SiteStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A site's model, once a second. objects: confirmed ones by class. tentative: not yet confirmed ones.

    last: the number of the last change. left_out: sightings that were not used, by reason. problems: in words, what
    keeps the model from being right, such as a robot without a map frame.
    """

    site: Name
    epoch: Epoch
    worker: Name
    sent_ns: Nanoseconds
    last: Count
    objects: Annotated[dict[Label, Count], msgspec.Meta(max_length=MAX_CHANGES)]
    tentative: Count
    views: Count
    sightings: Count
    left_out: Drops = {}
    lag_ns: Count = 0
    robots: Annotated[list[RobotOffset], msgspec.Meta(max_length=MAX_ROBOTS)] = []
    problems: Annotated[list[Label], msgspec.Meta(max_length=MAX_PROBLEMS)] = []


class FloorLooks(msgspec.Struct, frozen=True, kw_only=True):
    """When each cell of a site's floor was last looked at.

    origin: the lowest corner of the first cell, in the map. cell_m: side of a cell. columns: cells along x, rows: along
    y, the cells of a row one after another. ages: a little-endian uint16 a cell, seconds before now_ns, 65535 for
    longer ago or never; a view into the received payload.
    """

    site: Name
    now_ns: Nanoseconds
    origin: Point
    cell_m: Annotated[float, msgspec.Meta(gt=0, le=1_000)]
    columns: Annotated[int, msgspec.Meta(ge=0, le=MAX_CELLS)]
    rows: Annotated[int, msgspec.Meta(ge=0, le=MAX_CELLS)]
    ages: memoryview

    def __post_init__(self) -> None:
        """Check the number of cells.

        Raises:
            SchemaError: the ages are not as many.
        """
        if self.ages.nbytes != 2 * self.columns * self.rows:
            raise SchemaError(f"{self.ages.nbytes} bytes of ages for {self.columns} x {self.rows} cells")
