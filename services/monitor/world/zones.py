"""Zones: named polygons of a site's map, from a YAML file."""

import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Self

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, field_validator, model_validator
from pydantic_core import PydanticCustomError

from schemas.keys import NAME
from schemas.world import MAX_CORNERS
from services.yaml_text import YamlError, line_of, parse

MAX_ZONES: Final = 500
MAX_CHARACTERS: Final = 1_000_000
FARTHEST_M: Final = 100_000.0
LEAVES_M: Final = 0.2
"""How far outside a zone an object still counts as in it that was: estimates of a still object vary less."""

LEAST_CORNERS: Final = 3

Corner = tuple[float, float]
"""x, y in the site's map, in metres."""


class ZoneFileError(Exception):
    """A zone file cannot be used; the message names the file, the line and the cure."""


class Zone(BaseModel):
    """A polygon in a site's map. corners: in order around it, either way; the last one is joined to the first."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[^\x00-\x1f\x7f]+$")]
    site: Annotated[str, Field(pattern=f"^{NAME.pattern}$")] = "main"
    corners: Annotated[
        tuple[tuple[FiniteFloat, FiniteFloat], ...], Field(max_length=MAX_CORNERS, description="in metres")
    ]

    @field_validator("corners")
    @classmethod
    def _is_a_simple_polygon(cls, corners: tuple[Corner, ...]) -> tuple[Corner, ...]:
        if len(corners) < LEAST_CORNERS:
            raise ValueError(f"{len(corners)} corners: a zone needs at least {LEAST_CORNERS}")
        far = next((corner for corner in corners if max(map(abs, corner)) > FARTHEST_M), None)
        if far is not None:
            raise ValueError(f"{_said(far)} is more than {FARTHEST_M:,.0f} m from the map's origin")
        twice = next((corner for place, corner in enumerate(corners) if corner in corners[:place]), None)
        if twice is not None:
            raise ValueError(f"corner {_said(twice)} is given twice; leave one of them out")
        crossing = next(_crossings(corners), None)
        if crossing is not None:
            one, other = (f"{_said(begin)} to {_said(end)}" for begin, end in crossing)
            raise ValueError(f"its side {one} meets its side {other}; give the corners in order around the zone")
        return corners


class _ZoneFile(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    zones: Annotated[tuple[Zone, ...], Field(max_length=MAX_ZONES)]

    @model_validator(mode="after")
    def _names_are_unique(self) -> Self:
        known: set[tuple[str, str]] = set()
        for place, zone in enumerate(self.zones):
            if (zone.site, zone.name) in known:
                reason = f"two zones of site {zone.site} are called {zone.name!r}; rename one"
                raise PydanticCustomError(
                    "across_zones", "{reason}", {"reason": reason, "place": ("zones", place, "name")}
                )
            known.add((zone.site, zone.name))
        return self


def load_zones(path: Path) -> tuple[Zone, ...]:
    """Read a zone file.

    Raises:
        ZoneFileError: it cannot be read, or has a mistake.
    """
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(MAX_CHARACTERS + 1)
    except (OSError, UnicodeDecodeError) as error:
        raise ZoneFileError(f"zones {path}: {getattr(error, 'strerror', None) or error}") from error
    try:
        return parse_zones(text)
    except ZoneFileError as error:
        raise ZoneFileError(f"zones {path}: {error}") from error


def parse_zones(text: str) -> tuple[Zone, ...]:
    """Parse the text of a zone file.

    Raises:
        ZoneFileError: it has a mistake; the message names its line.
    """
    if len(text) > MAX_CHARACTERS:
        raise ZoneFileError(f"a zone file has at most {MAX_CHARACTERS:,} characters")
    try:
        content, root = parse(text)
    except YamlError as error:
        raise ZoneFileError(str(error)) from error
    if not isinstance(content, dict) or "zones" not in content:
        raise ZoneFileError("line 1: `zones` is missing; to have no zones, write `zones: []`")
    try:
        return _ZoneFile.model_validate(content).zones
    except ValidationError as error:
        mistakes = error.errors(include_url=False)  # misspelt keys first: they explain missing ones
        mistake = next((each for each in mistakes if each["type"] == "extra_forbidden"), mistakes[0])
        place = list(mistake.get("ctx", {}).get("place", mistake["loc"]))
        raise ZoneFileError(f"line {line_of(root, place)}: {_reason(place, content, mistake)}") from error


def check_zones(zones: Sequence[Zone]) -> tuple[Zone, ...]:
    """Return the zones if a file may hold them together.

    Raises:
        ZoneFileError: two of a site have one name, or there are too many.
    """
    try:
        return _ZoneFile(zones=tuple(zones)).zones
    except ValidationError as error:
        raise ZoneFileError(_reason([], None, error.errors(include_url=False)[0]).removeprefix("the file: ")) from error


def zone_of(name: str, site: str, corners: Sequence[Corner]) -> Zone:
    """Return the zone.

    Raises:
        ZoneFileError: there may be no such zone; the message says why.
    """
    try:
        return Zone(name=name, site=site, corners=tuple(corners))
    except ValidationError as error:
        mistake = error.errors(include_url=False)[0]
        said = _WORDS.get(mistake["type"], mistake["msg"].removeprefix("Value error, "))
        raise ZoneFileError(f"{mistake['loc'][0]}: {said}") from error


_WORDS: Final = {
    "missing": "is missing",
    "tuple_type": "write it as a list, like [[0, 0], [4, 0], [4, 3]]",
    "model_type": "write it as a mapping, like {name: dock, corners: [[0, 0], [4, 0], [4, 3]]}",
    "extra_forbidden": "is not a known key; a zone has name, site and corners",
}


def _reason(place: Sequence[Any], content: Any, mistake: Any) -> str:
    """Return what is wrong and of which zone, by its name where it has one."""
    match place:
        case ["zones", int(number), *rest]:
            zone = content["zones"][number]
            name = zone.get("name") if isinstance(zone, dict) else None
            begin = f"zone {name!r}" if isinstance(name, str) and name else f"zone {number + 1}"
            begin += "".join(f": {part}" for part in rest[:1])
        case _:
            begin = str(place[0]) if place else "the file"
    said = _WORDS.get(mistake["type"], mistake["msg"].removeprefix("Value error, "))
    if mistake["type"] == "too_long":
        said = "{actual_length} are given; there may be {max_length} at most".format(**mistake["ctx"])
    return f"{begin}: {said}"


def _said(corner: Corner) -> str:
    return f"[{corner[0]:g}, {corner[1]:g}]"


Side = tuple[Corner, Corner]


def _crossings(corners: Sequence[Corner]) -> Iterator[tuple[Side, Side]]:
    """Yield the pairs of sides that have a point in common, other than the corner between neighbours."""
    sides = list(zip(corners, (*corners[1:], corners[0]), strict=True))
    last = len(sides) - 1
    for one, (a, b) in enumerate(sides):
        for other in range(one + 1, len(sides)):
            c, d = sides[other]
            if other == one + 1 or (one, other) == (0, last):
                begin, shared, end = (a, b, d) if other == one + 1 else (c, a, b)
                if _turn(begin, shared, end) == 0 and _on(begin, shared, end):
                    yield (a, b), (c, d)
            elif _meet(a, b, c, d):
                yield (a, b), (c, d)


def _turn(a: Corner, b: Corner, c: Corner) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _on(a: Corner, b: Corner, c: Corner) -> bool:
    """Whether a side from b to c goes back along the one from a to b, all three being on one line."""
    return (a[0] - b[0]) * (c[0] - b[0]) + (a[1] - b[1]) * (c[1] - b[1]) > 0


def _meet(a: Corner, b: Corner, c: Corner, d: Corner) -> bool:
    turns = _turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)
    if turns[0] * turns[1] < 0 and turns[2] * turns[3] < 0:
        return True
    ends = ((a, b, c), (a, b, d), (c, d, a), (c, d, b))
    return any(turn == 0 and _between(*end) for turn, end in zip(turns, ends, strict=True))


def _between(a: Corner, b: Corner, c: Corner) -> bool:
    """Whether a point c on the line through a and b lies between them."""
    return min(a[0], b[0]) <= c[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= c[1] <= max(a[1], b[1])


@dataclass(frozen=True, slots=True)
class ZoneCount:
    """How many objects of each class are in a zone. current: they are known as of now."""

    zone: Zone
    objects: Mapping[str, int]
    current: bool


@dataclass(frozen=True, slots=True)
class _Polygon:
    name: str
    low: Corner
    high: Corner
    sides: tuple[Side, ...]

    @classmethod
    def of(cls, zone: Zone) -> Self:
        xs, ys = zip(*zone.corners, strict=True)
        sides = tuple(zip(zone.corners, (*zone.corners[1:], zone.corners[0]), strict=True))
        return cls(zone.name, (min(xs), min(ys)), (max(xs), max(ys)), sides)

    def holds(self, x: float, y: float) -> bool:
        """Whether a point is inside; the box around the polygon is tried first."""
        if not (self.low[0] <= x <= self.high[0] and self.low[1] <= y <= self.high[1]):
            return False
        inside = False
        for (ax, ay), (bx, by) in self.sides:
            if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
                inside = not inside
        return inside

    def is_near(self, x: float, y: float) -> bool:
        """Whether a point is at most LEAVES_M from the polygon's outline."""
        near_x = self.low[0] - LEAVES_M <= x <= self.high[0] + LEAVES_M
        near_y = self.low[1] - LEAVES_M <= y <= self.high[1] + LEAVES_M
        return near_x and near_y and any(_distance_m((x, y), side) <= LEAVES_M for side in self.sides)


def _distance_m(point: Corner, side: Side) -> float:
    (x, y), ((ax, ay), (bx, by)) = point, side
    dx, dy = bx - ax, by - ay
    along = max(0.0, min(1.0, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)))
    return math.hypot(ax + along * dx - x, ay + along * dy - y)


class ZoneFinder:
    """Says which of a site's zones an object is in. Zones may overlap."""

    def __init__(self, zones: Iterable[Zone]) -> None:
        self._polygons = tuple(_Polygon.of(zone) for zone in zones)

    def at(self, x: float, y: float, before: Container[str] = ()) -> tuple[str, ...]:
        """Return the names of the zones around a point, in the order of the file.

        before: zones that the object there was in. It stays in them until it is LEAVES_M outside: an object on a
        border, estimated now on this side and now on that, does not go in and out.
        """
        return tuple(
            each.name for each in self._polygons if each.holds(x, y) or (each.name in before and each.is_near(x, y))
        )
