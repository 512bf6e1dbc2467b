"""The map as two SVGs, one above the other: the ground with its objects, and robots. Pure: time is an argument."""

import colorsys
import math
import zlib
from base64 import b64encode
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final, Self

from services.monitor.liveness import OBJECT_FRESH_NS, is_recent
from services.monitor.map.floor_plan import FloorPlan
from services.monitor.map.footprints import DrawnObject, drawn_objects
from services.monitor.map.last_seen import MapObject
from services.monitor.map.pose import DrawnRobot
from services.monitor.world.site_status import totals
from services.monitor.world.zones import ZoneCount

NS: Final = 1_000_000_000
MOST_SHOWN: Final = 500
STALE: Final = "#9e9e9e"
WIDTH: Final = 1_200
HEIGHT: Final = 750
MARGIN_M: Final = 1.0
LEAST_M: Final = 8.0
MOST_LINES: Final = 14
STEPS_M: Final = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1_000, 5_000, 20_000, 100_000)
FARTHEST_M: Final = 100_000.0
"""Places farther from the map's origin are not drawn."""

SEED: Final = 645
"""Chosen so that colours of the shipped model's classes are far apart, and close to those of overlays."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """The area that the map shows, in metres."""

    left: float
    bottom: float
    right: float
    top: float

    @classmethod
    def around(cls, points: Iterable[tuple[float, float]], before: Self | None = None) -> Self | None:
        """Return bounds in whole metres around all points and the earlier bounds; None if there are none."""
        found = [(x, y) for x, y in points if abs(x) <= FARTHEST_M and abs(y) <= FARTHEST_M]
        if not found:
            return before
        xs, ys = zip(*found, strict=True)
        fitting = (
            math.floor(min(xs) - MARGIN_M),
            math.floor(min(ys) - MARGIN_M),
            math.ceil(max(xs) + MARGIN_M),
            math.ceil(max(ys) + MARGIN_M),
        )
        if before is None:
            return cls(*fitting)
        return cls(
            min(before.left, fitting[0]),
            min(before.bottom, fitting[1]),
            max(before.right, fitting[2]),
            max(before.top, fitting[3]),
        )


@dataclass(frozen=True, slots=True)
class _Scale:
    """Converts metres to the picture's units, y downwards."""

    centre: tuple[float, float]
    per_m: float

    @classmethod
    def of(cls, bounds: Bounds) -> Self:
        wide, high = (max(LEAST_M, bounds.right - bounds.left), max(LEAST_M, bounds.top - bounds.bottom))
        centre = ((bounds.left + bounds.right) / 2, (bounds.bottom + bounds.top) / 2)
        return cls(centre, min(WIDTH / wide, HEIGHT / high))

    def at(self, x: float, y: float) -> tuple[float, float]:
        across = WIDTH / 2 + (x - self.centre[0]) * self.per_m
        return round(across, 1), round(HEIGHT / 2 - (y - self.centre[1]) * self.per_m, 1)

    def back(self, across: float, down: float) -> tuple[float, float]:
        x = self.centre[0] + (across - WIDTH / 2) / self.per_m
        return round(x, 2), round(self.centre[1] - (down - HEIGHT / 2) / self.per_m, 2)


def colour_of(name: str) -> str:
    """Return the colour of a class, the same everywhere."""
    hue = zlib.crc32(f"{SEED}{name}".encode()) / 2**32
    red, green, blue = colorsys.hls_to_rgb(hue, 0.48, 0.75)
    return f"#{round(red * 255):02x}{round(green * 255):02x}{round(blue * 255):02x}"


def ground_of(
    bounds: Bounds,
    plan: tuple[FloorPlan, str] | None = None,
    *,
    looks: FloorPlan | None = None,
    zones: Sequence[ZoneCount] = (),
    objects: Sequence[DrawnObject] = (),
    chosen: str = "",
) -> str:
    """Return the map without what moves all the time: floor plan, grid, zones, and the objects of a world model.

    plan: what is under all of it, and where a browser finds its image. looks: when the floor was looked at. chosen:
    the id of an object to highlight.
    Names from the bus are escaped.
    """
    scale = _Scale.of(bounds)
    near = [each for each in objects if _is_near(each.of.at[0], each.of.at[1])]
    drawn = [
        *([] if plan is None else [_plan(*plan, scale)]),
        *([] if looks is None else [_plan(looks, f"data:image/png;base64,{b64encode(looks.png).decode()}", scale)]),
        *_grid(scale),
        *(_zone(each, scale) for each in zones),
        *drawn_objects(near, scale.at, colour_of, chosen=chosen),
    ]
    return _svg("fleet-map", "map", drawn)


def svg_of(bounds: Bounds, marks: Sequence[MapObject], robots: Sequence[DrawnRobot], now_ns: int) -> str:
    """Return what is above the ground: the first MOST_SHOWN marks, and robots. Names from the bus are escaped."""
    scale = _Scale.of(bounds)
    drawn = [
        *(_mark(mark, scale, now_ns) for mark in reversed(marks[:MOST_SHOWN])),
        *(_robot(robot, scale, now_ns) for robot in robots if _is_near(robot.pose.x, robot.pose.y)),
    ]
    return _svg("fleet-over", "robots and sightings", drawn)


def draft_of(bounds: Bounds, corners: Sequence[tuple[float, float]]) -> str:
    """Return a zone that is being drawn, above all else."""
    scale = _Scale.of(bounds)
    points = [scale.at(x, y) for x, y in corners if _is_near(x, y)]
    line = " ".join(f"{across},{down}" for across, down in points)
    dots = (f'<circle cx="{across}" cy="{down}" r="6"/>' for across, down in points)
    return _svg("fleet-draft", "the zone that is being drawn", [f'<polygon points="{line}"/>', *dots])


def metres_at(bounds: Bounds, across: float, down: float) -> tuple[float, float]:
    """Return what place of the map a point of the picture shows, in metres, rounded to centimetres."""
    return _Scale.of(bounds).back(across, down)


def _svg(name: str, label: str, drawn: Iterable[str]) -> str:
    return (
        f'<svg class="{name}" viewBox="0 0 {WIDTH} {HEIGHT}" role="group" aria-label="{label}">{"".join(drawn)}</svg>'
    )


def is_fresh(mark: MapObject, now_ns: int) -> bool:
    """Whether the mark was seen recently."""
    return is_recent(mark.seen_ns, now_ns, OBJECT_FRESH_NS)


def _is_near(x: float, y: float) -> bool:
    return abs(x) <= FARTHEST_M and abs(y) <= FARTHEST_M


def _plan(plan: FloorPlan, url: str, scale: _Scale) -> str:
    x, y = scale.at(plan.x, plan.y)
    wide, high = round(plan.width * scale.per_m, 1), round(plan.height * scale.per_m, 1)
    return (
        f'<g transform="translate({x} {y}) rotate({round(-math.degrees(plan.yaw), 2)})">'
        f'<image class="plan" href="{escape(url)}" y="{-high}" width="{wide}" height="{high}"'
        ' preserveAspectRatio="none"/></g>'
    )


def _zone(counted: ZoneCount, scale: _Scale) -> str:
    zone = counted.zone
    points = [scale.at(x, y) for x, y in zone.corners]
    x, y = min(x for x, _ in points), min(y for _, y in points)
    says = f"{zone.name}: {totals(counted.objects) if counted.current else 'not known'}"
    return (
        f'<g class="zone"><title>{escape(says)}</title>'
        f'<polygon points="{" ".join(f"{across},{down}" for across, down in points)}"/>'
        f'<text x="{x + 6}" y="{y + 20}">{escape(zone.name)}</text></g>'
    )


def _mark(mark: MapObject, scale: _Scale, now_ns: int) -> str:
    if not _is_near(mark.x, mark.y):
        return ""
    x, y = scale.at(mark.x, mark.y)
    fresh = is_fresh(mark, now_ns)
    fill = colour_of(mark.name) if fresh else STALE
    seen = f"{mark.name}, seen by {mark.robot}/{mark.camera} {_seconds(mark.seen_ns, now_ns)} s ago"
    state = "fresh" if fresh else "stale"
    return f'<circle class="seen {state}" cx="{x}" cy="{y}" r="10" fill="{fill}"><title>{escape(seen)}</title></circle>'


def _robot(robot: DrawnRobot, scale: _Scale, now_ns: int) -> str:
    x, y = scale.at(robot.pose.x, robot.pose.y)
    turn = round(-math.degrees(robot.pose.yaw), 1)
    state = "live" if robot.live else "lost"
    says = robot.name if robot.live else f"{robot.name}, last seen {_seconds(robot.pose.at_ns, now_ns)} s ago"
    return (
        f'<g class="robot {state}" transform="translate({x} {y})">'
        f'<path transform="rotate({turn})" d="M22 0 L-14 14 L-7 0 L-14 -14 Z"/>'
        f'<text y="-24" text-anchor="middle">{escape(says)}</text></g>'
    )


def _seconds(since_ns: int, now_ns: int) -> int:
    return max(0, now_ns - since_ns) // NS


def _grid(scale: _Scale) -> Iterator[str]:
    half = (WIDTH / 2 / scale.per_m, HEIGHT / 2 / scale.per_m)
    step = next((each for each in STEPS_M if 2 * half[0] / each <= MOST_LINES), STEPS_M[-1])
    for x in _multiples(scale.centre[0] - half[0], scale.centre[0] + half[0], step):
        across, _ = scale.at(x, 0)
        yield f'<line class="grid" x1="{across}" x2="{across}" y1="0" y2="{HEIGHT}"/>'
        yield f'<text class="metres" x="{across + 4}" y="{HEIGHT - 6}">{x} m</text>'
    for y in _multiples(scale.centre[1] - half[1], scale.centre[1] + half[1], step):
        _, down = scale.at(0, y)
        yield f'<line class="grid" x1="0" x2="{WIDTH}" y1="{down}" y2="{down}"/>'
        yield f'<text class="metres" x="4" y="{down - 5}">{y} m</text>'


def _multiples(low: float, high: float, step: int) -> Iterator[int]:
    yield from range(math.ceil(low / step) * step, math.floor(high / step) * step + 1, step)
