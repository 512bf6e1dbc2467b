"""Small robots, quickly rendered."""

from functools import cache
from typing import Final

from services.simulator.film import Equipment, Film, Store
from services.simulator.robot import Robot
from services.simulator.topics import SimulatedStream, topics
from services.simulator.world import Camera

COLOR: Final = Camera.with_field_of_view(64, 48, 1.2)
DEPTH: Final = Camera.with_field_of_view(80, 40, 1.5)
ALIGNED: Final = Equipment(COLOR)
UNALIGNED: Final = Equipment(COLOR, DEPTH, metric=True)
FRAMES: Final = 4
HZ: Final = 2.0
PLENTY: Final = 1 << 30


@cache
def film(equipment: Equipment = ALIGNED, seed: int = 1) -> Film:
    """Return a film of four instants; the same one for the same arguments."""
    return Film(seed, equipment, FRAMES, HZ, Store(PLENTY))


def robot(
    equipment: Equipment = ALIGNED, namespace: str = "", ahead: int = 0, streams: list[SimulatedStream] | None = None
) -> Robot:
    """Return a robot with all streams unless told otherwise."""
    published = topics(list(SimulatedStream) if streams is None else streams, aligned=equipment.aligned)
    return Robot("r1", namespace, film(equipment), published, ahead)
