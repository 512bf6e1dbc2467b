"""Models of the API's responses about sites, their zones and objects. Pure."""

from datetime import datetime

from pydantic import Field

from services.monitor.web.api.models import AlertAnswer, Figure, Part


class RobotOffsetAnswer(Part):
    """How far a robot's localisation is off: metres, and radians. doubted: why it is left out for now, or empty."""

    robot: str
    x: Figure
    y: Figure
    yaw: Figure
    doubted: str


class SiteAnswer(Part):
    """The objects of a site by class, each once. current: the world model reported within 5 seconds."""

    site: str
    worker: str
    current: bool
    last_seen: datetime | None
    objects: dict[str, int]
    tentative: int
    left_out: dict[str, int]
    problems: tuple[str, ...]
    robots: tuple[RobotOffsetAnswer, ...]


class ZoneAnswer(Part):
    """A zone of a site. corners: x, y in the site's map, metres. objects: by class, each once.

    current: its world model said so within 5 seconds, and the monitor has all of it.
    """

    site: str
    name: str
    corners: tuple[tuple[float, float], ...]
    current: bool
    objects: dict[str, int]


class SeerAnswer(Part):
    """A camera that saw an object, and when last."""

    robot: str
    camera: str
    last_seen: datetime


class ObjectAnswer(Part):
    """An object of a site as its world model told it last; metres, radians, metres a second, in the site's map.

    x, y, z: the centre of its upright box. sigma_m: standard deviation of x and y, the larger one. yaw: from the map's
    x axis to its length; None if unknown. existence: the probability that it is there. looked_in_vain: when its place
    was looked at last without it being seen, since it was seen. seen_by: the latest first. velocity: along x and y;
    None where its class stands still. current: its world model said so within 5 seconds, and the monitor has all of it.
    """

    site: str
    id: str
    name: str = Field(serialization_alias="class")
    current: bool
    x: Figure
    y: Figure
    z: Figure
    sigma_m: Figure
    length: Figure
    width: Figure
    height: Figure
    yaw: Figure | None
    zones: tuple[str, ...]
    existence: Figure
    first_seen: datetime | None
    last_seen: datetime | None
    looked_in_vain: datetime | None
    seen_by: tuple[SeerAnswer, ...]
    sightings: int
    velocity: tuple[Figure, Figure] | None


class EventAnswer(Part):
    """An event of an object: appeared, moved, gone, back or merged. x, y: where it is then, metres in the map.

    until: of a move, when it was told last. from_x, from_y: where it was before a move. into: the object that it turned
    out to be. by: the robot that saw it.
    """

    site: str
    object: str
    kind: str
    name: str = Field(serialization_alias="class")
    since: datetime
    until: datetime
    x: Figure
    y: Figure
    from_x: Figure | None
    from_y: Figure | None
    into: str
    by: str


class StockAnswer(Part):
    """A period in which a zone held a constant number of objects of a class. open: it continues.

    zone: empty for the whole site. class: empty for all classes together, of which there is a row whenever it is known.
    """

    site: str
    zone: str
    name: str = Field(serialization_alias="class")
    count: int
    since: datetime
    until: datetime
    open: bool


class SiteTotalsAnswer(Part):
    """The objects of one site of a warehouse, each once, by class. current: a world model said so as of its report."""

    site: str
    current: bool
    objects: dict[str, int]


class WarehouseAnswer(Part):
    """A warehouse as its monitor reported last. current: it did so in the last ten seconds.

    page: the address of its own page, empty where it told none. objects: of all its sites, each once, by class; those
    that cameras have in view where no site is looked after. alerts: how many are open, by severity; open_alerts: these,
    the most severe first, at most 100.
    """

    warehouse: str
    current: bool
    last_report: datetime
    version: str
    page: str
    robots: int
    robots_online: int
    cameras: int
    cameras_online: int
    workers: int
    objects: dict[str, int]
    in_view: dict[str, int]
    sites: tuple[SiteTotalsAnswer, ...]
    alerts: dict[str, int]
    open_alerts: tuple[AlertAnswer, ...]
    problems: tuple[str, ...]
