"""Classes of objects: typical sizes, which of them move, and how surely the detector finds them. Pure."""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

MAX_CLASSES: Final = 256
MOST_BROUGHT: Final = 64
"""Classes that a robot may bring of which no object is confirmed."""

NO_CLASS: Final = -1
"""The number of a class that there is no room for."""

BANDS: Final = 6
BAND_M: Final = 2.0
"""Hit rates are learned per band of distance: BANDS of BAND_M each, the last one for all that is farther."""

LEAST_LOOKS: Final = 20.0
"""Weight of the assumed hit rate, in looks."""

ASSUMED_RATE: Final = 0.7


@dataclass(frozen=True, slots=True)
class Size:
    """The usual size of a class: length, width, height, and how much level sides and heights vary (1 sigma), metres."""

    length: float
    width: float
    height: float
    sigma: float
    height_sigma: float
    moves: bool = False


UNKNOWN_SIZE: Final = Size(0.6, 0.5, 0.5, 0.4, 0.6)
USUAL: Final[Mapping[str, Size]] = {
    "box": Size(0.45, 0.35, 0.35, 0.15, 0.2),
    "pallet": Size(1.2, 0.9, 0.144, 0.12, 0.02),
    "forklift": Size(2.6, 1.15, 2.1, 0.4, 0.4, moves=True),
    "person": Size(0.5, 0.4, 1.75, 0.2, 0.2, moves=True),
    "pedestrian": Size(0.5, 0.4, 1.75, 0.2, 0.2, moves=True),
    "robot": Size(0.8, 0.6, 0.6, 0.3, 0.4, moves=True),
}

LARGE_M: Final = 1.5
"""Things of a class that is usually longer are seen in parts, and merged where parts are nearer than they can be."""


def _rates() -> NDArray[np.float64]:
    return np.full((MAX_CLASSES, BANDS), ASSUMED_RATE * LEAST_LOOKS)


def _looks() -> NDArray[np.float64]:
    return np.full((MAX_CLASSES, BANDS), LEAST_LOOKS)


@dataclass(slots=True, eq=False)
class Classes:
    """The classes that a site's sightings are of, numbered in the order in which they came.

    Where there is no room for a new one, it takes the number of one without objects, see `release`.

    usual: sizes by name; other classes are of UNKNOWN_SIZE until told otherwise.
    """

    usual: Mapping[str, Size] = field(default_factory=lambda: USUAL)
    names: list[str] = field(default_factory=list)
    sizes: NDArray[np.float64] = field(default_factory=lambda: np.zeros((MAX_CLASSES, 5)))
    moves: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(MAX_CLASSES, np.bool_))
    hits: NDArray[np.float64] = field(default_factory=_rates)
    looks: NDArray[np.float64] = field(default_factory=_looks)
    _numbers: dict[str, int] = field(default_factory=dict)
    _free: set[int] = field(default_factory=set)
    _by: dict[int, str] = field(default_factory=dict)
    _brought: Counter[str] = field(default_factory=Counter)

    def number(self, name: str, robot: str = "") -> int:
        """Return a class's number, a new one for a new name that a robot brings; NO_CLASS where there is no room."""
        found = self._numbers.get(name, NO_CLASS)
        if found >= 0 and found not in self._free:
            return found
        if self._brought[robot] >= MOST_BROUGHT or (found < 0 and len(self.names) >= MAX_CLASSES and not self._free):
            return NO_CLASS
        if found < 0:
            found = self._new(name)
        self._free.discard(found)
        if robot:
            self._by[found] = robot
            self._brought[robot] += 1
        return found

    def _new(self, name: str) -> int:
        if len(self.names) < MAX_CLASSES:
            found = len(self.names)
            self.names.append(name)
        else:
            found = min(self._free)
            del self._numbers[self.names[found]]
            self.names[found] = name
            self.hits[found], self.looks[found] = ASSUMED_RATE * LEAST_LOOKS, LEAST_LOOKS
        self._numbers[name] = found
        size = self.usual.get(name, UNKNOWN_SIZE)
        self.sizes[found] = size.length, size.width, size.height, size.sigma, size.height_sigma
        self.moves[found] = size.moves
        return found

    @property
    def is_short(self) -> bool:
        """Whether a robot, or the site, has as many as it may."""
        return len(self.names) >= MAX_CLASSES or max(self._brought.values(), default=0) >= MOST_BROUGHT

    def release(self, used: Collection[int], confirmed: Collection[int]) -> None:
        """Let new classes have the numbers of those without objects, and robots bring others in their place.

        used: of all objects. confirmed: of those that are.
        """
        self._free = set(range(len(self.names))).difference(used)
        self._by = {number: by for number, by in self._by.items() if number in used and number not in confirmed}
        self._brought = Counter(self._by.values())

    def forget(self, robots: Collection[str]) -> None:
        """Forget which classes robots brought."""
        self._by = {number: by for number, by in self._by.items() if by not in robots}
        self._brought = Counter(self._by.values())

    def is_large(self, classes: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which of these classes are of things that a camera sees in parts."""
        return np.asarray(self.sizes[classes, 0] > LARGE_M)

    def rate(self, classes: NDArray[np.intp], distance_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how likely an object of each class is detected, unhidden at that distance."""
        band = bands(distance_m)
        return np.asarray(self.hits[classes, band] / self.looks[classes, band])

    def learn(self, classes: NDArray[np.intp], distance_m: NDArray[np.float64], seen: NDArray[np.bool_]) -> None:
        """Count looks at confirmed objects, and which of them the detector found."""
        band = bands(distance_m)
        np.add.at(self.looks, (classes, band), 1.0)
        np.add.at(self.hits, (classes, band), seen.astype(np.float64))


def bands(distance_m: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the band of each distance."""
    return np.minimum(distance_m / BAND_M, BANDS - 1).astype(np.intp)
