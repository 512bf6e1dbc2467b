"""A robot's round through a scene: a closed path around obstacles, looking at nearby objects."""

from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Final, Self

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from services.simulator.world.camera import Pose
from services.simulator.world.clearance import Clearance
from services.simulator.world.scene import Scene

STRIDE: Final = 4
NEIGHBOURS: Final = tuple((r, c, float(np.hypot(r, c))) for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c)
Cell = tuple[int, int]


class RouteMap:
    """A coarse grid of the largest connected free area; cells are (row, column) of that grid."""

    def __init__(self, clearance: Clearance, margin: float) -> None:
        self._clearance = clearance
        room = clearance.grid[::STRIDE, ::STRIDE]
        _, areas, stats, _ = cv2.connectedComponentsWithStats((room > margin).astype(np.uint8), connectivity=4)
        largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()) if len(stats) > 1 else -1
        self.free: NDArray[np.bool_] = areas == largest
        self._cost = np.where(self.free, 1 + 0.4 / np.maximum(room, 0.05), np.inf)

    def points(self, cells: NDArray[np.intp]) -> NDArray[np.float64]:
        """Map points (n, 2) of cells (n, 2)."""
        return self._clearance.points(cells * STRIDE)

    def route(self, start: Cell, goal: Cell) -> list[Cell]:
        """The cells from `start` to `goal`, both of which are free."""
        came_from: dict[Cell, Cell] = {}
        best = {start: 0.0}
        queue = [(0.0, start)]
        while queue:
            _, cell = heappop(queue)
            if cell == goal:
                break
            for row, column, length in NEIGHBOURS:
                there = (cell[0] + row, cell[1] + column)
                if not self._is_free(there):
                    continue
                cost = best[cell] + length * float(self._cost[there])
                if cost < best.get(there, np.inf):
                    best[there], came_from[there] = cost, cell
                    ahead = np.hypot(there[0] - goal[0], there[1] - goal[1])
                    heappush(queue, (cost + float(ahead), there))
        path = [goal]
        while path[-1] != start:
            path.append(came_from[path[-1]])
        return path[::-1]

    def _is_free(self, cell: Cell) -> bool:
        rows, columns = self.free.shape
        return 0 <= cell[0] < rows and 0 <= cell[1] < columns and bool(self.free[cell])


Points = NDArray[np.float64]
SPACING: Final = 0.05
ROBOT_RADIUS: Final = 0.3
MARGIN: Final = 0.45
STOPS: Final = 7
VIEW_DISTANCE: Final = (1.2, 2.6)
TURN_METRES: Final = 1.2
FIELD: Final = np.radians(100)


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """A closed way of evenly spaced `points` (n, 2) in metres, with the heading of the camera at each."""

    points: Points
    headings: Points
    camera_height: float
    camera_pitch: float

    @classmethod
    def plan(cls, scene: Scene, seed: int = 0) -> Self:
        """A round through `scene`; other seeds give other rounds. Raises ValueError when there is no room."""
        rng = np.random.default_rng([scene.seed, 3, seed])
        clearance = Clearance.of(scene)
        routes = RouteMap(clearance, MARGIN)
        if not routes.free.any():
            raise ValueError(f"no room to drive in scene {scene.seed}")
        objects = _objects(scene)
        points = _smooth_way(_closed_way(routes, _stops(routes, objects, rng)), clearance)
        height = float(rng.uniform(0.55, 0.95))
        return cls(points, _headings(points, objects), height, float(rng.uniform(-0.16, -0.06)))

    @property
    def length(self) -> float:
        """Metres once around."""
        return len(self.points) * SPACING

    def pose(self, fraction: float) -> Pose:
        """The camera's pose after `fraction` of the round; whole numbers are the start."""
        place = fraction % 1.0 * len(self.points)
        here, part = int(place) % len(self.points), place % 1.0
        there = (here + 1) % len(self.points)
        x, y = (1 - part) * self.points[here] + part * self.points[there]
        turn = (self.headings[there] - self.headings[here] + np.pi) % (2 * np.pi) - np.pi
        yaw = float(self.headings[here] + part * turn)
        return Pose.looking(float(x), float(y), self.camera_height, yaw, self.camera_pitch)


def _objects(scene: Scene) -> Points:
    """The positions of the objects that a robot's camera would look at, (n, 2)."""
    centres = scene.instance_centres()[1:]
    return np.asarray(centres[centres[:, 2] < 1.3, :2], np.float64)


def _stops(routes: RouteMap, objects: Points, rng: Generator) -> list[Cell]:
    """Free cells with a view of some object, far from each other, in the order of a round."""
    cells = np.argwhere(routes.free)
    points = routes.points(cells)
    if len(objects):
        nearest = np.min([np.hypot(*(points - place).T) for place in objects], axis=0)
        viewing = (nearest > VIEW_DISTANCE[0]) & (nearest < VIEW_DISTANCE[1])
        if viewing.sum() > STOPS:
            cells, points = cells[viewing], points[viewing]
    chosen = [int(rng.integers(len(cells)))]
    gap = np.hypot(*(points - points[chosen[0]]).T)
    while len(chosen) < min(STOPS, len(cells)):
        chosen.append(int(gap.argmax()))
        gap = np.minimum(gap, np.hypot(*(points - points[chosen[-1]]).T))
    around = points[chosen] - points[chosen].mean(axis=0)
    order = np.argsort(np.arctan2(around[:, 1], around[:, 0]))
    return [(int(row), int(column)) for row, column in cells[np.array(chosen)[order]]]


def _closed_way(routes: RouteMap, stops: list[Cell]) -> Points:
    cells: list[Cell] = []
    for here, there in zip(stops, stops[1:] + stops[:1], strict=True):
        cells += routes.route(here, there)[:-1]
    return routes.points(np.array(cells or stops[:1]))


def _smooth_way(corners: Points, clearance: Clearance) -> Points:
    """The path evenly spaced, and as smooth as the room around it allows."""
    exact = _evenly(corners)
    for window_metres in (1.2, 0.8, 0.4, 0.2):
        smooth = _evenly(_circular_mean(exact, round(window_metres / SPACING)))
        if clearance.at(smooth).min() > ROBOT_RADIUS:
            return smooth
    return exact


def _evenly(corners: Points) -> Points:
    closed = np.concatenate([corners, corners[:1]])
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    count = max(1, int(travelled[-1] / SPACING))
    marks = np.arange(count) * (travelled[-1] / count)
    return np.stack([np.interp(marks, travelled, closed[:, axis]) for axis in range(2)], axis=1)


def _circular_mean(values: Points, window: int) -> Points:
    """The moving average of (n, 2) values around a closed way."""
    half = min(window // 2, len(values) // 2)
    padded = np.concatenate([values[len(values) - half :], values, values[:half]])
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(padded, axis=0)])
    width = 2 * half + 1
    return np.asarray((sums[width:] - sums[:-width]) / width)


def _headings(points: Points, objects: Points) -> Points:
    """Headings towards the nearest object that is not behind, smoothed; straight ahead where there is none."""
    ahead = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    travel = np.arctan2(ahead[:, 1], ahead[:, 0])
    look = np.stack([np.cos(travel), np.sin(travel)], axis=1)
    if len(objects):
        towards = objects[None] - points[:, None]
        distance = np.hypot(towards[..., 0], towards[..., 1])
        bearing = np.arctan2(towards[..., 1], towards[..., 0])
        turn = np.abs((bearing - travel[:, None] + np.pi) % (2 * np.pi) - np.pi)
        score = distance + 1.5 * turn + np.where((turn > FIELD) | (distance > 6), 100, 0)
        best = score.argmin(axis=1)
        chosen = np.arange(len(points)), best
        seen = score[chosen] < 100
        look[seen] += 3 * (towards[chosen] / np.maximum(distance[chosen], 0.1)[:, None])[seen]
    return _steady(np.arctan2(look[:, 1], look[:, 0]))


def _steady(headings: Points) -> Points:
    """Headings around a closed way without sudden turns, however often the way winds about itself."""
    unwound = np.unwrap(headings)
    count = len(unwound)
    closing = (headings[0] - unwound[-1] + np.pi) % (2 * np.pi) - np.pi
    slope = (unwound[-1] + closing - unwound[0]) / count * np.arange(count)
    wiggle = np.stack([unwound - slope, np.zeros(count)], axis=1)
    for _ in range(2):
        wiggle = _circular_mean(wiggle, round(TURN_METRES / SPACING))
    return np.asarray(wiggle[:, 0] + slope)
