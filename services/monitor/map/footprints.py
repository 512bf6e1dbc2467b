"""The objects of a world model as the map draws them: their boxes from above, faded by age. Pure."""

import heapq
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from itertools import groupby
from typing import Final
from urllib.parse import quote

from schemas.world import WorldObject
from services.monitor.world.site_objects import PlacedObject

NS: Final = 1_000_000_000
MOST_OBJECTS: Final = 1_000
"""Objects that are drawn, those seen last."""

AGES_S: Final = (60, 600, 3_600, 86_400)
"""Ages at which an object fades. The first is more than world models take to tell of one again that is in view."""

MOVING_MPS: Final = 0.1
"""Speed from which a line shows where an object goes."""

Point = tuple[float, float]

Placing = Callable[[float, float], Point]
"""Converts metres in the map to the picture's units."""

Colouring = Callable[[str], str]
"""Returns the colour of a class."""


@dataclass(frozen=True, slots=True)
class DrawnObject:
    """An object to draw. age: how many of AGES_S have passed since it was seen; len(AGES_S) where that is not known."""

    of: WorldObject
    age: int


def address_of(of: WorldObject) -> str:
    """Return the address of an object's page."""
    return address_of_id(of.site, of.id)


def address_of_id(site: str, object_id: str) -> str:
    """Return the address of the page of an object by its id."""
    return f"/world/{quote(site, safe='')}/{quote(object_id, safe='')}"


def footprint(of: WorldObject) -> tuple[Point, Point, Point, Point]:
    """Return the corners of an object's box in the map, in metres, in order around it."""
    turn = of.yaw or 0.0
    along, across = (math.cos(turn), math.sin(turn)), (-math.sin(turn), math.cos(turn))
    half_length, half_width = of.size[0] / 2, of.size[1] / 2

    def corner(far: int, left: int) -> Point:
        x = of.at[0] + far * half_length * along[0] + left * half_width * across[0]
        return x, of.at[1] + far * half_length * along[1] + left * half_width * across[1]

    return corner(1, 1), corner(1, -1), corner(-1, -1), corner(-1, 1)


def age_of(of: WorldObject, now_ns: int) -> int:
    """Return how many of AGES_S have passed since an object was seen."""
    seconds = (now_ns - of.last_ns) / NS
    return sum(seconds >= age for age in AGES_S)


def newest_of(
    objects: Iterable[PlacedObject], now_ns: int, *, name: str = "", robot: str = "", known: bool = True
) -> tuple[list[DrawnObject], int]:
    """Return the objects to draw, those seen last first, and how many there are in all.

    name: of this class alone. robot: those alone that it saw lately. known: their world model is there.
    """
    wanted = [each.of for each in objects if name in ("", each.of.name) and _saw(robot, each.of)]
    newest = heapq.nlargest(MOST_OBJECTS, wanted, key=lambda of: (of.last_ns, of.id))
    return [DrawnObject(of, age_of(of, now_ns) if known else len(AGES_S)) for of in newest], len(wanted)


def _saw(robot: str, of: WorldObject) -> bool:
    return not robot or any(seer.robot == robot for seer in of.seen_by)


def drawn_objects(
    objects: Sequence[DrawnObject], place: Placing, colour_of: Colouring, *, chosen: str = ""
) -> Iterator[str]:
    """Yield the objects as SVG, each a link to its page; the oldest are below. chosen: the id of one to highlight."""
    below = sorted(objects, key=lambda each: (*_layer(each), each.of.last_ns))
    for (older, name), some in groupby(below, key=_layer):
        paths = "".join(_path(each.of, place, chosen) for each in some)
        yield f'<g class="things age{-older}" fill="{colour_of(name)}">{paths}</g>'


def _layer(each: DrawnObject) -> tuple[int, str]:
    return -each.age, each.of.name


def _path(of: WorldObject, place: Placing, chosen: str) -> str:
    corners = " ".join(f"{x},{y}" for x, y in (place(*corner) for corner in footprint(of)))
    says = escape(f"{of.name} {of.id}")
    on = ' class="chosen"' if of.id == chosen else ""
    return (
        f'<a href="{address_of(of)}" tabindex="-1" aria-label="{says}"{on}><title>{says}</title>'
        f'<polygon points="{corners}"/>{_course(of, place)}</a>'
    )


def _course(of: WorldObject, place: Placing) -> str:
    """Return a line from a moving object to where it is in a second."""
    vx, vy = of.velocity or (0.0, 0.0)
    if math.hypot(vx, vy) < MOVING_MPS:
        return ""
    (x1, y1), (x2, y2) = place(of.at[0], of.at[1]), place(of.at[0] + vx, of.at[1] + vy)
    return f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}"/>'
