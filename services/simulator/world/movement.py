"""Ways of things on the floor: where they are at each instant, and whether there is room."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from services.simulator.world.clearance import Clearance
from services.simulator.world.cuboids import Frame

Points = NDArray[np.float64]

DRIVE_M_S: Final = 1.2
SLIDE_M_S: Final = 0.7

SPACING_M: Final = 0.25
SMOOTH: Final = 5
"""Points over which a way is smoothed."""

BORDER_M: Final = 0.15
"""Distance between the points of an outline that must have room."""

ROOM_M: Final = 0.08
"""Room around an outline."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Where a thing is `seconds` (n,) after it set out: `places` (n, 3) of x, y in metres and yaw; even in between."""

    seconds: Points
    places: Points

    @classmethod
    def standing(cls, place: Frame) -> Self:
        """Being at a place at once."""
        return cls(np.zeros(1), np.array([[place.x, place.y, place.yaw]]))

    @property
    def lasts_s(self) -> float:
        """Seconds until it is there."""
        return float(self.seconds[-1])

    def place(self, second: float) -> Frame:
        """Where it is then; before it sets out at the start, and once there at the end."""
        x, y, yaw = (float(np.interp(second, self.seconds, self.places[:, axis])) for axis in range(3))
        return Frame(x, y, 0.0, yaw)


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A rectangle on the floor in the frame of what it is around: low and high corner (2, 2) in metres."""

    corners: Points

    @property
    def radius(self) -> float:
        """How far it reaches from its frame."""
        return float(np.hypot(*np.abs(self.corners).max(axis=0)))

    def distance(self, place: Frame, points: Points) -> Points:
        """Metres from points (n, 2) to the rectangle at a place, 0 inside."""
        local = _to_frame(place, points)
        return np.asarray(np.hypot(*np.maximum(np.maximum(self.corners[0] - local, local - self.corners[1]), 0).T))

    def fits(self, clearance: Clearance, place: Frame) -> bool:
        """Whether there is room for it at a place."""
        (left, bottom), (right, top) = self.corners.tolist()
        across = np.linspace(left, right, max(2, round((right - left) / BORDER_M)))
        up = np.linspace(bottom, top, max(2, round((top - bottom) / BORDER_M)))
        grid = np.stack(np.meshgrid(across, up), axis=-1).reshape(-1, 2)
        cos, sin = np.cos(place.yaw), np.sin(place.yaw)
        there = grid @ np.array([[cos, sin], [-sin, cos]]) + (place.x, place.y)
        return bool(clearance.at(there).min() > ROOM_M)


def _to_frame(place: Frame, points: Points) -> Points:
    cos, sin = np.cos(place.yaw), np.sin(place.yaw)
    return np.asarray((points - (place.x, place.y)) @ np.array([[cos, -sin], [sin, cos]]))


def arcs(here: Frame, pieces: Sequence[tuple[float, float]]) -> Motion:
    """A truck's way from a place along arcs: metres of each, negative for backwards, and its curvature in 1/m."""
    places = [(here.x, here.y, here.yaw)]
    travelled = [0.0]
    for length, curvature in pieces:
        count = max(1, round(abs(length) / SPACING_M))
        step = length / count
        for _ in range(count):
            x, y, yaw = places[-1]
            middle = yaw + step * curvature / 2
            places.append((x + step * np.cos(middle), y + step * np.sin(middle), yaw + step * curvature))
            travelled.append(travelled[-1] + abs(step))
    return Motion(np.array(travelled) / DRIVE_M_S, np.array(places))


def there_and_back(motion: Motion, wait_s: float) -> Motion:
    """The same way, then a wait, then the way back."""
    back = motion.lasts_s + wait_s + (motion.lasts_s - motion.seconds[::-1])
    return Motion(np.append(motion.seconds, back), np.concatenate([motion.places, motion.places[::-1]]))


def slide_way(here: Frame, route: Points) -> Motion:
    """The way of goods along a route (n, 2), as if by a hand pallet truck: they keep their heading."""
    points = _smooth(here, route)
    return Motion(_travelled(points) / SLIDE_M_S, np.column_stack([points, np.full(len(points), here.yaw)]))


def _smooth(here: Frame, route: Points) -> Points:
    """An evenly spaced, smooth way from a place along a route."""
    corners = np.concatenate([[[here.x, here.y]], route])
    travelled = _travelled(corners)
    count = max(3, round(float(travelled[-1]) / SPACING_M))
    marks = np.linspace(0, travelled[-1], count)
    points = np.stack([np.interp(marks, travelled, corners[:, axis]) for axis in range(2)], axis=1)
    half = min(SMOOTH // 2, (count - 1) // 2)
    padded = np.concatenate([2 * points[:1] - points[half:0:-1], points, 2 * points[-1:] - points[-2 : -half - 2 : -1]])
    window = np.ones(2 * half + 1) / (2 * half + 1)
    return np.stack([np.convolve(padded[:, axis], window, "valid") for axis in range(2)], axis=1)


def _travelled(points: Points) -> Points:
    return np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
