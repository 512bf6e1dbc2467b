"""The inventory: what the monitor answers to queries about the whole fleet, and what it reports to a centre.

A centre is a monitor above several warehouses. A warehouse has one monitor (or two beside a PostgreSQL), and as many
sites, maps of their own, as it has halls or floors.
"""

from typing import Annotated, Final

import msgspec

from schemas.alerts import MAX_TEXT, Alert
from schemas.header import Count, Label, MaybeName, Name, Nanoseconds
from schemas.space import Distance
from schemas.status import Drops

MAX_SIGHTINGS: Final = 20_000
"""Maximum number of sightings in one answer; query robot by robot for more."""


MAX_PROBLEMS: Final = 16


class InventoryRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A query for sightings of one robot, camera or class, each of all if empty.

    name: of the class. in_view: only what is in view now, as far as anybody knows. A field that is not known is an
    error: left out, a misspelt one would be answered with everything.
    """

    robot: MaybeName = ""
    camera: MaybeName = ""
    name: Label = ""
    in_view: bool = False


class ClassSighting(msgspec.Struct, frozen=True, kw_only=True):
    """One class in view of one camera, or its last sighting there.

    count: how many now, 0 when it is in view no more. score: best one, 0 to 1. first_ns, last_ns: when it was seen
    first and last without a gap, nanoseconds since the epoch on the monitor's system clock. nearest_m: how near the
    nearest of them is, where that is known. model, worker: who said so. available: the robot is online and class lists
    of its camera arrive; otherwise the sighting is the last that was known.

    >>> sighting = fleetsight.ClassSighting(
    ...     robot="r1", camera="front", name="box", count=3, score=0.91, first_ns=10**18, last_ns=10**18 + 5 * 10**9,
    ...     nearest_m=2.5, model="my.pt", worker="w1", available=True,
    ... )
    >>> (sighting.last_ns - sighting.first_ns) / 1e9  # seconds in view
    5.0
    """

    robot: Name
    camera: Name
    name: Label
    count: Count
    score: Annotated[float, msgspec.Meta(ge=0, le=1)]
    first_ns: Nanoseconds
    last_ns: Nanoseconds
    nearest_m: Distance | None = None
    model: Label
    worker: Label
    available: bool


class InventoryAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """The answer, as of now_ns of the monitor's system clock, by robot, camera and class.

    complete: False if there are more than fit into one answer. class_lists: how many the monitor took in since it
    started, each once. left_out: messages that it did not take in, by reason. problems: in words, what keeps it from
    doing all that it should.

    >>> answer = fleetsight.InventoryAnswer(now_ns=10**18, sightings=[])
    >>> sum(each.count for each in answer.sightings if each.name == "box" and each.available)
    0
    """

    now_ns: Nanoseconds
    sightings: Annotated[list[ClassSighting], msgspec.Meta(max_length=MAX_SIGHTINGS)]
    complete: bool = True
    class_lists: Count = 0
    left_out: Drops = {}
    problems: Annotated[list[Label], msgspec.Meta(max_length=MAX_PROBLEMS)] = []


MAX_REPORTED_SITES: Final = 64
MAX_CLASSES: Final = 256
MAX_REPORTED_ALERTS: Final = 100

Totals = Annotated[dict[Label, Count], msgspec.Meta(max_length=MAX_CLASSES)]
"""How many objects there are, by class."""


class SiteTotals(msgspec.Struct, frozen=True, kw_only=True):
    """The objects of one site, each once. current: a world model says so now, and the monitor has all of it."""

    site: Name
    current: bool
    objects: Totals


class WarehouseReport(msgspec.Struct, frozen=True, kw_only=True):
    """A warehouse as its monitor has it, every two seconds.

    version: of the monitor's software. sent_ns: since the epoch on its system clock. page: the address of its own page,
    empty where it does not know it (`--web-url`). robots, cameras: known ones; workers: those that report now.
    in_view: objects that cameras have in view, by class; one that several cameras see counts several times.
    alerts: how many are not resolved, by severity. open: these alerts, the most severe and then the newest first, as
    far as they fit. problems: in words, what keeps the monitor from doing all that it should.
    """

    warehouse: Name
    version: Label
    sent_ns: Nanoseconds
    page: Annotated[str, msgspec.Meta(max_length=MAX_TEXT)] = ""
    robots: Count
    robots_online: Count
    cameras: Count
    cameras_online: Count
    workers: Count
    in_view: Totals
    sites: Annotated[list[SiteTotals], msgspec.Meta(max_length=MAX_REPORTED_SITES)] = []
    alerts: Annotated[dict[MaybeName, Count], msgspec.Meta(max_length=MAX_PROBLEMS)] = {}
    open: Annotated[list[Alert], msgspec.Meta(max_length=MAX_REPORTED_ALERTS)] = []
    problems: Annotated[list[Label], msgspec.Meta(max_length=MAX_PROBLEMS)] = []
