"""Errors of a robot's localisation: a slow drift, and being lost for a while. Pure."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from services.simulator.placement import Placement, at

COMPONENTS: Final = 128
"""Sine waves whose sum is a drift: it has the spectrum of an Ornstein-Uhlenbeck process, up to waves of a second."""

LOST_DEG: Final = (20.0, 90.0)
"""A lost robot's heading is off by at least and at most so much, to either side."""

_LOST: Final = re.compile(r"(?P<robot>r[1-9][0-9]*)=(?P<begins>[0-9]+(\.[0-9]+)?)-(?P<ends>[0-9]+(\.[0-9]+)?)")

Errors = tuple[float, float, float]
"""x and y in metres, heading in radians."""


@dataclass(frozen=True, slots=True)
class Drift:
    """A stationary drift in x, y and heading, each on its own; its autocorrelation falls by 1/e in `seconds`.

    metres, degrees: one standard deviation.
    """

    metres: float = 0.0
    degrees: float = 0.0
    seconds: float = 30.0


@dataclass(frozen=True, slots=True)
class Lost:
    """A time in which a robot takes itself to be `metres` away from where it is, with another heading; in seconds."""

    robot: str
    begins_s: float
    ends_s: float
    metres: float = 3.0

    @classmethod
    def parse(cls, text: str, metres: float = 3.0) -> Self:
        """Read a time such as `r1=60-80`.

        Raises:
            ValueError: it is none.
        """
        found = _LOST.fullmatch(text)
        if found is None or float(found["begins"]) >= float(found["ends"]):
            raise ValueError(f"{text!r} is no time in which a robot is lost; write r1=60-80 for seconds 60 to 80")
        return cls(found["robot"], float(found["begins"]), float(found["ends"]), metres)


class Localisation:
    """How far a robot's localisation is off at each instant: always the same for the same arguments.

    lost: times of this robot. seed: of the robot's own errors.
    """

    def __init__(self, drift: Drift, lost: Sequence[Lost] = (), seed: Sequence[int] = (0,)) -> None:
        rng = np.random.default_rng([*seed, 5])
        even = (np.arange(COMPONENTS) + rng.uniform(0.1, 0.9, (3, COMPONENTS))) / COMPONENTS
        self._rates = np.tan(even * np.pi / 2) / drift.seconds
        self._phases = rng.uniform(0, 2 * np.pi, (3, COMPONENTS))
        scale = np.array([drift.metres, drift.metres, np.radians(drift.degrees)])
        self._amplitudes = scale * np.sqrt(2 / COMPONENTS)
        self._lost = [(each, *_jump(rng)) for each in lost]

    def error(self, second: float) -> Errors:
        """Return how far the pose is off at a time since the start, in seconds."""
        x, y, yaw = (np.sin(self._rates * second + self._phases).sum(axis=1) * self._amplitudes).tolist()
        for each, away, turn in self._lost:
            if each.begins_s <= second < each.ends_s:
                x, y, yaw = x + each.metres * np.cos(away), y + each.metres * np.sin(away), yaw + turn
        return float(x), float(y), float(yaw)


def _jump(rng: np.random.Generator) -> tuple[float, float]:
    """Return the direction of a jump, and how far the heading jumps, in radians."""
    return float(rng.uniform(-np.pi, np.pi)), float(np.radians(rng.uniform(*LOST_DEG)) * rng.choice([-1, 1]))


def disturbed(placement: Placement, error: Errors) -> Placement:
    """Return a placement in the map, turned about its own place by an error's heading and moved by its x and y."""
    x, y, turn = error
    made = placement.copy()
    made[:3, :3] = at(yaw=turn)[:3, :3] @ placement[:3, :3]
    made[:2, 3] += (x, y)
    return made
