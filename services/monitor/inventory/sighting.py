"""A sighting: one class in view of one camera, from when it was seen first to when it was seen last."""

from dataclasses import dataclass
from enum import StrEnum

from schemas.keys import CameraKey


@dataclass(frozen=True, slots=True)
class Sighting:
    """One class in view of one camera, without a gap. Times are nanoseconds since the epoch on the monitor's clock.

    count: how many now; 0 when it went out of view. most: the largest count of the sighting. score: best one of the
    newest list that had it. nearest_m: how near the nearest of them is, where that is known. model, worker: who said so
    last.
    """

    key: CameraKey
    name: str
    count: int
    most: int
    score: float
    first_ns: int
    last_ns: int
    model: str
    worker: str
    nearest_m: float | None = None


class ChangeKind(StrEnum):
    """What became of a sighting."""

    APPEARED = "appeared"
    COUNTED = "counted"
    VANISHED = "vanished"
    LOST = "lost"
    """Nobody says any more whether it is still there."""


@dataclass(frozen=True, slots=True)
class Change:
    """What became of a sighting when. first_look: it was there when somebody began to look, nobody saw it come."""

    kind: ChangeKind
    sighting: Sighting
    at_ns: int
    first_look: bool = False
