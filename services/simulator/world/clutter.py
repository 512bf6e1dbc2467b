"""Things in a warehouse that a model must not take for boxes, pallets or forklifts."""

import numpy as np
from numpy.random import Generator

from services.simulator.world.cuboids import Builder, Frame, Material, Paint, Solid
from services.simulator.world.props import Colour, shade_of

COLOURS: tuple[Colour, ...] = (
    (0.15, 0.3, 0.6),
    (0.8, 0.8, 0.78),
    (0.2, 0.2, 0.22),
    (0.1, 0.45, 0.3),
    (0.8, 0.3, 0.1),
    (0.75, 0.65, 0.15),
)


def clutter(builder: Builder, rng: Generator, frame: Frame) -> None:
    """One drum, cabinet, cone, bin, barrier or trolley."""
    paint = Paint(Material.METAL, shade_of(rng, COLOURS[int(rng.integers(len(COLOURS)))]))
    kinds = (_drum, _cabinet, _cone, _bin, _barrier, _trolley)
    kinds[int(rng.integers(len(kinds)))](builder.background(frame), paint)


def _drum(solid: Solid, paint: Paint) -> None:
    for yaw in (0, np.pi / 6, np.pi / 3):
        solid.cuboid((0, 0, 0.44), (0.27, 0.26, 0.44), paint, yaw=yaw)


def _cabinet(solid: Solid, paint: Paint) -> None:
    solid.cuboid((0, 0, 0.95), (0.4, 0.25, 0.95), paint)
    solid.cuboid((0, 0.255, 1.0), (0.01, 0.005, 0.8), Paint(Material.PLAIN, (0.1, 0.1, 0.1)))


def _cone(solid: Solid, _paint: Paint) -> None:
    orange, white = Paint(Material.PLAIN, (0.95, 0.35, 0.1)), Paint(Material.PLAIN, (0.95, 0.95, 0.95))
    solid.cuboid((0, 0, 0.02), (0.18, 0.18, 0.02), orange)
    for ring in range(5):
        radius = 0.12 - 0.022 * ring
        solid.cuboid((0, 0, 0.09 + 0.1 * ring), (radius, radius, 0.05), white if ring % 2 else orange)


def _bin(solid: Solid, paint: Paint) -> None:
    dark = Paint(Material.PLAIN, (0.12, 0.12, 0.13))
    for y in (-0.33, 0.33):
        solid.cuboid((0, y, 0.45), (0.45, 0.02, 0.35), paint)
    for x in (-0.43, 0.43):
        solid.cuboid((x, 0, 0.45), (0.02, 0.33, 0.35), paint)
    solid.cuboid((0, 0, 0.12), (0.44, 0.33, 0.02), dark)
    for x in (-0.35, 0.35):
        solid.cuboid((x, 0, 0.05), (0.05, 0.25, 0.05), dark)


def _barrier(solid: Solid, _paint: Paint) -> None:
    hazard = Paint(Material.HAZARD, (1.0, 1.0, 1.0))
    solid.cuboid((0, 0, 0.9), (0.75, 0.025, 0.09), hazard)
    for x in (-0.7, 0.7):
        solid.cuboid((x, 0, 0.48), (0.04, 0.04, 0.48), hazard)
        solid.cuboid((x, 0, 0.02), (0.06, 0.25, 0.02), Paint(Material.PLAIN, (0.1, 0.1, 0.1)))


def _trolley(solid: Solid, paint: Paint) -> None:
    dark = Paint(Material.PLAIN, (0.12, 0.12, 0.13))
    for z in (0.2, 0.75):
        solid.cuboid((0, 0, z), (0.45, 0.28, 0.015), paint)
    for x in (-0.44, 0.44):
        for y in (-0.27, 0.27):
            solid.cuboid((x, y, 0.5), (0.015, 0.015, 0.45), paint)
            solid.wheel((x * 0.9, y, 0.07), 0.07, 0.02, dark)
