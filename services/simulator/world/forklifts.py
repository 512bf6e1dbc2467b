"""Forklifts of several looks: counterbalance trucks, reach trucks and stackers, facing +x."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from services.simulator.world.cuboids import Builder, Frame, Material, Paint, Solid
from services.simulator.world.props import Colour, loaded_pallet, pallet, shade_of

BODY_COLOURS: tuple[Colour, ...] = (
    (0.92, 0.66, 0.08),
    (0.92, 0.42, 0.07),
    (0.86, 0.74, 0.14),
    (0.75, 0.16, 0.12),
    (0.24, 0.5, 0.26),
    (0.16, 0.32, 0.62),
    (0.82, 0.82, 0.8),
)


@dataclass(frozen=True, slots=True)
class Livery:
    """The paints of one truck."""

    body: Paint
    trim: Paint
    steel: Paint
    dark: Paint
    counterweight: Paint

    @classmethod
    def draw(cls, rng: Generator) -> "Livery":
        colour = BODY_COLOURS[int(rng.choice(7, p=[0.28, 0.2, 0.14, 0.13, 0.1, 0.08, 0.07]))]
        body = Paint(Material.METAL, shade_of(rng, colour))
        dark = Paint(Material.METAL, shade_of(rng, (0.12, 0.12, 0.13), 0.02))
        grey = Paint(Material.METAL, shade_of(rng, (0.36, 0.36, 0.38), 0.05))
        hazard = Paint(Material.HAZARD, (1.0, 1.0, 1.0))
        rear = (body, grey, dark, hazard)[int(rng.choice(4, p=[0.4, 0.25, 0.2, 0.15]))]
        return cls(body, (dark, body)[int(rng.random() < 0.4)], grey, dark, rear)


def forklift(builder: Builder, rng: Generator, frame: Frame) -> None:
    """One truck at random, with or without something on its forks."""
    kinds = (_counterbalance, _reach_truck, _stacker)
    reach, height = kinds[int(rng.choice(3, p=[0.68, 0.2, 0.12]))](builder.object(frame, "forklift"), rng)
    if rng.random() < 0.35:
        place = frame.at(reach + 0.62, 0, height - 0.05, np.pi / 2 * int(rng.integers(2)))
        if rng.random() < 0.7:
            loaded_pallet(builder, rng, place, 0.9)
        else:
            pallet(builder, rng, place)


def _lift(rng: Generator) -> float:
    return float(rng.choice([0.0, 0.0, rng.uniform(0, 0.4), rng.uniform(0.4, 1.2)]))


def _mast(solid: Solid, livery: Livery, *, x: float, height: float, lift: float, spread: float) -> None:
    """A mast at `x` with a carriage, a load guard and two forks `lift` metres above the floor."""
    for y in (-spread, spread):
        solid.cuboid((x, y, height / 2 + 0.05), (0.07, 0.05, height / 2), livery.steel)
        solid.cuboid((x + 0.65, y * 0.75, 0.07 + lift), (0.55, 0.055, 0.02), livery.dark)
        solid.cuboid((x + 0.12, y * 0.75, 0.35 + lift), (0.022, 0.055, 0.28), livery.dark)
        solid.cuboid((x + 0.02, y * 0.6, height * 0.45), (0.03, 0.03, height * 0.42), livery.dark)
    for z in (0.3, height * 0.55, height):
        solid.cuboid((x, 0, z), (0.04, spread, 0.05), livery.steel)
    for z in (0.25, 0.55, 1.15):
        solid.cuboid((x + 0.1, 0, z + lift), (0.02, spread * 1.5, 0.04), livery.dark)
    for y in np.linspace(-spread * 1.4, spread * 1.4, 5):
        solid.cuboid((x + 0.1, float(y), 0.85 + lift), (0.014, 0.014, 0.3), livery.dark)


def _overhead_guard(solid: Solid, livery: Livery, *, front: float, rear: float, half_width: float, top: float) -> None:
    base = 0.75
    half_height = (top - base) / 2
    for y in (-half_width, half_width):
        solid.cuboid((front, y, base + half_height), (0.04, 0.035, half_height + 0.03), livery.trim, pitch=-0.12)
        solid.cuboid((rear, y, base + half_height), (0.04, 0.035, half_height), livery.trim)
        solid.cuboid(((front + rear) / 2, y, top), ((front - rear) / 2, 0.035, 0.035), livery.trim)
    for x in np.linspace(rear, front - 0.05, 5):
        solid.cuboid((float(x), 0, top + 0.01), (0.03, half_width, 0.02), livery.trim)


def _counterbalance(solid: Solid, rng: Generator) -> tuple[float, float]:
    livery, lift, size = Livery.draw(rng), _lift(rng), float(rng.uniform(0.92, 1.1))
    half_width = 0.48 * size
    solid.cuboid((-0.05, 0, 0.46), (0.75, half_width, 0.26), livery.body)
    solid.cuboid((-0.88 * size, 0, 0.62), (0.24, half_width * 1.04, 0.42), livery.counterweight)
    solid.cuboid((-0.38, 0, 0.84), (0.38, half_width * 0.86, 0.14), livery.body)
    solid.cuboid((-0.35, 0, 1.03), (0.24, 0.24, 0.06), livery.dark)
    solid.cuboid((-0.58, 0, 1.27), (0.06, 0.23, 0.24), livery.dark)
    solid.cuboid((0.42, 0, 0.92), (0.1, half_width * 0.75, 0.22), livery.trim)
    solid.cuboid((0.26, 0, 1.17), (0.03, 0.16, 0.1), livery.dark, pitch=0.5)
    _overhead_guard(solid, livery, front=0.45, rear=-0.72, half_width=half_width * 0.95, top=2.08 * size)
    for y in (-half_width * 1.02, half_width * 1.02):
        for x, radius in ((0.6, 0.31), (-0.76, 0.25)):
            solid.wheel((x, y, radius), radius, 0.1, livery.dark)
            solid.cuboid((x, y, radius), (radius * 0.45, 0.11, radius * 0.45), livery.steel, pitch=0.4)
    _mast(solid, livery, x=0.92, height=float(rng.uniform(1.95, 2.4)), lift=lift, spread=0.33)
    return 0.98, lift + 0.09


def _reach_truck(solid: Solid, rng: Generator) -> tuple[float, float]:
    livery, lift = Livery.draw(rng), _lift(rng)
    solid.cuboid((-0.55, 0, 0.62), (0.5, 0.55, 0.5), livery.body)
    solid.cuboid((-0.95, 0, 0.75), (0.16, 0.5, 0.6), livery.counterweight)
    solid.cuboid((-0.35, 0.2, 1.2), (0.1, 0.25, 0.25), livery.dark)
    solid.cuboid((-0.05, -0.3, 1.15), (0.1, 0.2, 0.12), livery.trim, pitch=0.3)
    _overhead_guard(solid, livery, front=0.1, rear=-0.95, half_width=0.5, top=2.15)
    for y in (-0.5, 0.5):
        solid.cuboid((0.7, y, 0.17), (0.75, 0.09, 0.09), livery.body)
        solid.wheel((1.35, y, 0.15), 0.15, 0.06, livery.dark)
        solid.wheel((-0.7, y * 0.9, 0.18), 0.18, 0.08, livery.dark)
    _mast(solid, livery, x=0.35, height=float(rng.uniform(2.1, 2.7)), lift=lift, spread=0.34)
    return 0.42, lift + 0.09


def _stacker(solid: Solid, rng: Generator) -> tuple[float, float]:
    livery, lift = Livery.draw(rng), _lift(rng)
    solid.cuboid((-0.2, 0, 0.5), (0.26, 0.38, 0.42), livery.body)
    solid.cuboid((-0.2, 0, 0.95), (0.22, 0.34, 0.05), livery.trim)
    solid.cuboid((-0.75, 0, 1.0), (0.35, 0.04, 0.035), livery.dark, pitch=0.35)
    solid.cuboid((-1.05, 0, 1.13), (0.05, 0.2, 0.04), livery.dark)
    for y in (-0.3, 0.3):
        solid.cuboid((0.7, y, 0.08), (0.6, 0.07, 0.05), livery.body)
        solid.wheel((-0.25, y, 0.1), 0.1, 0.05, livery.dark)
    _mast(solid, livery, x=0.15, height=float(rng.uniform(1.7, 2.1)), lift=lift, spread=0.28)
    return 0.21, lift + 0.09
