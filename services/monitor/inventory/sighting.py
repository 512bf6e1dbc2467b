"""A sighting: one class in view of one camera, from first seen to last seen."""

from enum import StrEnum
from typing import Final

import msgspec

from schemas.keys import CameraKey


class Sighting(msgspec.Struct, frozen=True, gc=False):
    """One class in view of one camera, without a gap. Times are nanoseconds since the epoch on the monitor's clock.

    count: how many now, since since_ns; 0 when it went out of view. score: best one of the newest list that had it.
    nearest_m: how near the nearest of them is, where that is known; closest_m: the nearest that any came since
    since_ns. model, worker: who said so last.
    """

    key: CameraKey
    name: str
    count: int
    score: float
    first_ns: int
    since_ns: int
    last_ns: int
    model: str
    worker: str
    nearest_m: float | None = None
    closest_m: float | None = None


class ChangeKind(StrEnum):
    """The kind of a sighting's change."""

    APPEARED = "appeared"
    COUNTED = "counted"
    VANISHED = "vanished"
    LOST = "lost"
    """No class list tells any more whether it is still in view."""


class Change(msgspec.Struct, frozen=True, gc=False):
    """A change of a sighting.

    first_look: it was in view in the first lists, so its arrival was not seen. closest_m: the nearest distance
    during the previous count.
    """

    kind: ChangeKind
    sighting: Sighting
    first_look: bool = False
    closest_m: float | None = None


NS: Final = 1_000_000_000
