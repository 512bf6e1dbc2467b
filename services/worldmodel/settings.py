"""Settings of a worker of the world model."""

from collections import Counter
from pathlib import Path
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from bus.settings import BusSettings
from bus.sharing.settings import WorkerSettings
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL
from schemas.keys import check_name

ANY: str = "*"


def _site(value: str) -> str:
    name, _, robots = value.partition("=")
    try:
        check_name("site", name)
        for robot in robots.split("+") if robots not in {"", ANY} else ():
            check_name("robot", robot)
    except SchemaError as error:
        raise ValueError(f"{error}; write a site as hall-2=r1+r2, or main=* for every robot") from error
    return value


SiteText = Annotated[str, AfterValidator(_site)]


class WorldSettings(WorkerSettings, BusSettings):
    """Keep one inventory of each site: every object once, where it is, from what all its robots see."""

    sites: list[SiteText] = Field(
        default=["main=*"],
        min_length=1,
        max_length=1_000,
        description="maps and the robots that drive in them, such as hall-2=r1+r2, or main=* for every robot that no"
        " other site names; workers with the same sites share them",
    )
    state: Path | None = Field(
        default=None, description="folder in which the sites' objects are kept over restarts; by default nowhere"
    )
    frame: Annotated[str, Field(min_length=1, max_length=MAX_LABEL)] = Field(
        default="map", description="the frame of reference of a site's map, as its robots call it"
    )
    drift_m: float = Field(
        default=0.05, gt=0, le=10, description="how far robots' positions are off, 1 standard deviation in metres"
    )
    drift_deg: float = Field(
        default=1.0, gt=0, le=90, description="how far their headings are off, 1 standard deviation in degrees"
    )
    refresh_s: float = Field(
        default=10.0, ge=1, le=3_600, description="least time between two updates about an object in view, in seconds"
    )
    nearby_m: float = Field(
        default=8.0, gt=0, le=1_000, description="radius around a robot in which objects are sent to it, in metres"
    )
    nearby_s: float = Field(
        default=600.0, gt=0, description="seconds after its last sighting for which an object is sent to robots"
    )
    nearby_hz: float = Field(default=2.0, gt=0, le=20, description="updates a second that a robot gets, at most")
    most_objects: int = Field(default=100_000, ge=1, le=1_000_000, description="objects of a site, at most")

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        if len(self.robots_of) < len(self.sites):
            raise ValueError("sites: each may be given once")
        named = Counter(robot for robots in self.robots_of.values() for robot in robots or (ANY,))
        for robot, count in named.items():
            if count > 1:
                given = "every robot" if robot == ANY else f"robot {robot}"
                raise ValueError(f"sites: {given} is given {count} times, and a robot drives in one site")
        return self

    @property
    def robots_of(self) -> dict[str, tuple[str, ...]]:
        """The robots of each site; none for every robot that no other site names."""
        split = (text.partition("=") for text in self.sites)
        return {name: () if robots in {"", ANY} else tuple(robots.split("+")) for name, _, robots in split}

    def elsewhere(self, site: str) -> frozenset[str]:
        """Return the robots that other sites name."""
        return frozenset(robot for name, robots in self.robots_of.items() if name != site for robot in robots)
