"""A warehouse that changes by a seeded schedule, with its exact truth at each instant.

Forklifts drive, goods are taken away, brought and moved; always the same for the same arguments.
"""

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum, auto
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.simulator.world.clearance import Clearance
from services.simulator.world.cuboids import Frame
from services.simulator.world.drive import ROBOT_RADIUS, STRIDE, Drive, RouteMap
from services.simulator.world.movement import Motion, Outline, arcs, slide_way, there_and_back
from services.simulator.world.scene import Places, Scene, arranged, arranged_cuboids, outline_of
from services.simulator.world.truth import PresentObject, present_in

Points = NDArray[np.float64]

KINDS: Final = (0.4, 0.25, 0.2, 0.15)
"""How often each kind of change is tried, in the order of `ChangeKind`, where there is something for it."""

SLIDE_M: Final = (1.0, 8.0)
"""How far goods are moved at least and at most, as the crow flies."""

NEAR_M: Final = 0.8
"""How far goods may be from where a route can begin."""

ARCS: Final = 3
ARC_M: Final = (1.5, 4.0)
MOST_CURVED: Final = 0.4
"""Trucks drive along at most so many arcs, so long, and of at most this curvature in 1/m."""

DRIVERS_WAIT_S: Final = (1.0, 6.0)
ROBOTS_M: Final = ROBOT_RADIUS + 0.4
"""Room between a robot's middle and what changes."""

STEP_S: Final = 0.25
TRIES: Final = 30
WAIT_S: Final = 1.0
"""Time between tries: a robot was in the way, or there was no room."""

IN_VAIN: Final = 100
"""Attempts in a row without a possible change after which the world stays as it is."""


class ChangeKind(StrEnum):
    """DRIVEN: a forklift drives. MOVED: goods are moved along the floor. TAKEN, BROUGHT: at once, away or back."""

    DRIVEN = auto()
    MOVED = auto()
    TAKEN = auto()
    BROUGHT = auto()


@dataclass(frozen=True, slots=True)
class Change:
    """A change of the scene's movable of that number, in seconds since the start. motion: None for away."""

    kind: ChangeKind
    movable: int
    begins_s: float
    ends_s: float
    motion: Motion | None

    def place(self, second: float) -> Frame | None:
        """Where the movable is at a time since the change began; None for away."""
        return None if self.motion is None else self.motion.place(second - self.begins_s)


@dataclass(frozen=True, slots=True)
class Travel:
    """A robot's rounds: at second 0 it has done `start` of one, and each takes `round_s`."""

    drive: Drive
    round_s: float
    start: float = 0.0

    def place(self, second: float) -> Points:
        """Where the robot's camera is, (2,)."""
        return self.drive.pose(self.start + second / self.round_s).position[:2].astype(np.float64)


class ChangingWorld:
    """A scene and what becomes of it; times are seconds since the start. Not for several threads.

    per_minute: how many changes there are, at most; they come at random, one after the other. travels: of the robots in
    it. Things keep clear of each other and of robots; nothing is put where a robot drives.
    """

    def __init__(self, scene: Scene, per_minute: float, travels: Sequence[Travel] = ()) -> None:
        self.still = scene
        self._planned = _Planner(scene, per_minute, travels).changes()
        self._changes: list[Change] = []
        self._begins: list[float] = [0.0]
        self._newest: tuple[dict[int, Frame | None], Scene] = {}, scene

    def changes(self, second: float) -> Sequence[Change]:
        """The changes that have begun by then, in the order in which they began."""
        while self._begins[-1] <= second:
            change = next(self._planned, None)
            if change is None:
                self._begins.append(math.inf)
                break
            self._changes.append(change)
            self._begins.append(change.begins_s)
        return self._changes[: bisect_right(self._begins, second) - 1]

    def places(self, second: float) -> dict[int, Frame | None]:
        """Where the movables are that have changed by then, by number; None for away."""
        newest = {change.movable: change for change in self.changes(second)}
        return {movable: change.place(second) for movable, change in newest.items()}

    def scene(self, second: float) -> Scene:
        """The scene at an instant: `render`, `truth` and `turn` take it as they take any other."""
        places = self.places(second)
        if places != self._newest[0]:
            self._newest = places, arranged(self.still, places)
        return self._newest[1]

    def objects(self, second: float) -> tuple[PresentObject, ...]:
        """Every object that is there at an instant: its instance, class and upright box in the map."""
        return present_in(self.unpainted(second))

    def unpainted(self, second: float, places: Places | None = None) -> Scene:
        """The scene at an instant without its colours: enough for `render_geometry`, `truth` and `turn`'s ranges.

        places: where some movables are taken to be instead, by number; None for away.
        """
        return replace(self.still, cuboids=arranged_cuboids(self.still, {**self.places(second), **(places or {})}))


class _Planner:
    """Works changes out one after the other. places: where the movables are that are not at home."""

    def __init__(self, scene: Scene, per_minute: float, travels: Sequence[Travel]) -> None:
        self._scene = scene
        self._gap_s = 60 / per_minute
        self._travels = travels
        self._rng = np.random.default_rng([scene.seed, 6])
        self._places: dict[int, Frame | None] = {}
        self._outlines = [Outline(outline_of(scene, each)) for each in scene.movables]
        ways = [travel.drive.points for travel in travels]
        self._ways: Points = np.concatenate(ways) if ways else np.empty((0, 2))
        self._off_ways = _distances(Clearance.of(scene), self._ways)
        self._rooms: dict[int, Clearance] = {}

    def changes(self) -> Iterator[Change]:
        """Yield changes, forever, or until none was possible for IN_VAIN attempts."""
        second, in_vain = 0.0, 0
        while in_vain < IN_VAIN:
            second += float(self._rng.exponential(self._gap_s))
            change = self._found(second)
            if change is None:
                second += TRIES * WAIT_S
                in_vain += 1
                continue
            in_vain = 0
            self._places[change.movable] = change.place(change.ends_s)
            self._rooms.clear()
            second = max(second, change.ends_s)
            yield change

    def _found(self, second: float) -> Change | None:
        """Find a change that can begin about then."""
        for kind in self._rng.choice(list(ChangeKind), len(ChangeKind), replace=False, p=KINDS):
            for attempt in range(TRIES):
                which = self._candidates(ChangeKind(kind))
                if not which:
                    break
                number = which[int(self._rng.integers(len(which)))]
                change = self._change(ChangeKind(kind), number, second + attempt * WAIT_S)
                if change is not None:
                    return change
        return None

    def _candidates(self, kind: ChangeKind) -> list[int]:
        movables = self._scene.movables
        there = [number for number in range(len(movables)) if self._place(number) is not None]
        goods = [number for number in there if movables[number].name != "forklift"]
        match kind:
            case ChangeKind.DRIVEN:
                return [number for number in there if movables[number].name == "forklift"]
            case ChangeKind.MOVED:
                return goods
            case ChangeKind.TAKEN:
                away = [number for number, place in self._places.items() if place is None]
                return goods if len(goods) > len(away) else []
            case ChangeKind.BROUGHT:
                return [number for number in range(len(movables)) if self._place(number) is None]

    def _place(self, number: int) -> Frame | None:
        return self._places.get(number, self._scene.movables[number].frame)

    def _change(self, kind: ChangeKind, number: int, begins_s: float) -> Change | None:
        outline, here = self._outlines[number], self._place(number)
        if kind is ChangeKind.TAKEN:
            motion = None
            places = [] if here is None else [(begins_s, here)]
        else:
            motion = self._motion(number, outline, here)
            if motion is None:
                return None
            seconds = np.append(np.arange(0, motion.lasts_s, STEP_S), motion.lasts_s).tolist()
            places = [(begins_s + second, motion.place(second)) for second in seconds]
        if not self._is_clear(outline, places):
            return None
        return Change(kind, number, begins_s, begins_s + (0.0 if motion is None else motion.lasts_s), motion)

    def _motion(self, number: int, outline: Outline, here: Frame | None) -> Motion | None:
        """A way for something at random, or a place for what is away; None where there is no room."""
        room = self._room(number)
        if here is None:
            return self._spot(room, outline)
        if self._scene.movables[number].name == "forklift":
            return self._drive(room, outline, here)
        return self._slide(room, outline, here)

    def _room(self, number: int) -> Clearance:
        """The room that everything but a movable leaves."""
        if number not in self._rooms:
            others = arranged_cuboids(self._scene, self._places | {number: None})
            self._rooms[number] = Clearance.of(replace(self._scene, cuboids=others))
        return self._rooms[number]

    def _spot(self, room: Clearance, outline: Outline) -> Motion | None:
        free = (room.grid[::STRIDE, ::STRIDE] > outline.radius) & (self._off_ways > outline.radius + ROBOTS_M)
        cells = np.argwhere(free) * STRIDE
        if not len(cells):
            return None
        x, y = room.points(cells[int(self._rng.integers(len(cells)))]).tolist()
        return Motion.standing(Frame(x, y, 0.0, float(self._rng.uniform(-np.pi, np.pi))))

    def _drive(self, room: Clearance, outline: Outline, here: Frame) -> Motion | None:
        """Drive along some arcs, and come back where robots drive there."""
        rng = self._rng
        forwards = rng.choice([-1, 1], ARCS)
        lengths, curvatures = rng.uniform(*ARC_M, ARCS), rng.uniform(-MOST_CURVED, MOST_CURVED, ARCS)
        pieces = list(zip((forwards * lengths).tolist(), curvatures.tolist(), strict=True))[
            : int(rng.integers(ARCS)) + 1
        ]
        wait_s = float(rng.uniform(*DRIVERS_WAIT_S))
        motion = arcs(here, pieces)
        *_, last = places = _sampled(motion)
        if not all(outline.fits(room, place) for place in places):
            return None
        off_ways = not len(self._ways) or outline.distance(last, self._ways).min() > ROBOTS_M
        return motion if off_ways else there_and_back(motion, wait_s)

    def _slide(self, room: Clearance, outline: Outline, here: Frame) -> Motion | None:
        """Move goods along the floor to where no robot drives."""
        routes = RouteMap(room, outline.radius)
        cells = np.argwhere(routes.free)
        points = routes.points(cells)
        away = np.hypot(points[:, 0] - here.x, points[:, 1] - here.y)
        off_ways = self._off_ways[cells[:, 0], cells[:, 1]] > outline.radius + ROBOTS_M
        goals = np.flatnonzero((away > SLIDE_M[0]) & (away < SLIDE_M[1]) & off_ways)
        if not len(goals) or away.min() > NEAR_M:
            return None
        start, goal = cells[int(away.argmin())].tolist(), cells[int(self._rng.choice(goals))].tolist()
        motion = slide_way(here, routes.points(np.array(routes.route(tuple(start), tuple(goal)))))
        return motion if all(outline.fits(room, place) for place in _sampled(motion)) else None

    def _is_clear(self, outline: Outline, places: Sequence[tuple[float, Frame]]) -> bool:
        """Whether no robot is near these places at these times."""
        return all(
            float(outline.distance(place, np.array([travel.place(second)]))[0]) > ROBOTS_M
            for second, place in places
            for travel in self._travels
        )


def _distances(clearance: Clearance, ways: Points) -> Points:
    """Metres from each cell of routes to where robots drive."""
    rows, columns = clearance.grid[::STRIDE, ::STRIDE].shape
    if not len(ways):
        return np.full((rows, columns), np.inf)
    cells = np.stack(np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"), axis=-1) * STRIDE
    return np.stack([np.hypot(*(each[:, None] - ways).T).min(axis=0) for each in clearance.points(cells)])


def _sampled(motion: Motion) -> list[Frame]:
    """Places along a motion, the last one included."""
    return [motion.place(second) for second in np.append(np.arange(0, motion.lasts_s, STEP_S), motion.lasts_s).tolist()]
