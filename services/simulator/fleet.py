"""Assigns robots to warehouses and drives."""

from collections.abc import Iterator
from typing import Final

from services.simulator.film import Equipment, Film, Store
from services.simulator.localisation import Drift, Localisation
from services.simulator.robot import Robot
from services.simulator.settings import SimulatorSettings
from services.simulator.topics import topics
from services.simulator.world import Camera, ChangingWorld, Drive, Travel, generate

COLOR_FIELD_RAD: Final = 1.2
DEPTH_FIELD_RAD: Final = 1.5
BEHIND: Final = 4
"""Instants between a robot and the one behind it in the same warehouse.

Near enough that what the first one needed is still all that the others need: a loop is rendered at the rate of one
robot, however many drive along it.
"""


def equipment(settings: SimulatorSettings) -> Equipment:
    """Return the sensors that the settings describe."""
    color = Camera.with_field_of_view(settings.width, settings.height, COLOR_FIELD_RAD)
    depth = Camera.with_field_of_view(settings.depth_width, settings.depth_height, DEPTH_FIELD_RAD)
    return Equipment(color, None if settings.align_depth else depth, metric=settings.depth_encoding == "32FC1")


def warehouse_seed(seed: int, number: int = 0) -> int:
    """Return the seed of a warehouse of a fleet, counted from 0."""
    return seed + 1 + number


def robots(settings: SimulatorSettings, *, namespaced: bool) -> Iterator[Robot]:
    """Make the robots one after the other; each new warehouse takes a moment. namespaced: topics like `/r1/tf`."""
    store = Store(settings.memory_mib << 20)
    films: dict[int, Film] = {}
    published = topics(settings.streams, aligned=settings.align_depth)
    for number in range(settings.robots):
        convoy, warehouse = divmod(number, settings.warehouses)
        if warehouse not in films:
            seed = warehouse_seed(settings.seed, warehouse)
            world = _world(settings, warehouse) if settings.changes_per_minute else None
            films[warehouse] = Film(seed, equipment(settings), settings.frames, settings.hz, store, world=world)
        name = f"r{number + 1}"
        yield Robot(
            name,
            f"/{name}" if namespaced else "",
            films[warehouse],
            published,
            ahead=convoy * BEHIND,
            localisation=_localisation(settings, number),
        )


def _world(settings: SimulatorSettings, warehouse: int) -> ChangingWorld:
    """Return a warehouse that changes around the robots that share it."""
    scene = generate(warehouse_seed(settings.seed, warehouse))
    drive = Drive.plan(scene)
    round_s = settings.frames / settings.hz
    numbers = range(warehouse, settings.robots, settings.warehouses)
    ahead = [convoy * BEHIND - number / settings.robots for convoy, number in enumerate(numbers)]
    travels = [Travel(drive, round_s, each / settings.frames) for each in ahead]
    return ChangingWorld(scene, settings.changes_per_minute, travels)


def _localisation(settings: SimulatorSettings, number: int) -> Localisation | None:
    """Return the errors of a robot, counted from 0; None where it has none."""
    drift = Drift(settings.drift_m, settings.drift_deg, settings.drift_s)
    lost = [each for each in settings.times_lost if each.robot == f"r{number + 1}"]
    if not (drift.metres or drift.degrees or lost):
        return None
    return Localisation(drift, lost, (settings.seed, number))
