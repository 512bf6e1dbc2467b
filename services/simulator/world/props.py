"""Boxes, pallets, loads and racks."""

import numpy as np
from numpy.random import Generator

from services.simulator.world.cuboids import Builder, Frame, Material, Paint, Solid

Colour = tuple[float, float, float]
DECK_HEIGHT = 0.144


def shade_of(rng: Generator, colour: Colour, common: float = 0.05, each: float = 0.02) -> Colour:
    """`colour` a little lighter or darker, and a little off in hue."""
    red, green, blue = np.clip(np.add(colour, rng.normal(0, common) + rng.normal(0, each, 3)), 0.02, 1.2)
    return float(red), float(green), float(blue)


def box_colour(rng: Generator) -> Colour:
    """The tint over the brown of the cardboard texture: mostly brown, some white, grey or dark boxes."""
    kinds: list[Colour] = [(1.0, 1.0, 1.0), (1.35, 1.6, 2.1), (0.95, 1.1, 1.35), (0.7, 0.68, 0.66)]
    return shade_of(rng, kinds[int(rng.choice(4, p=[0.74, 0.1, 0.06, 0.1]))], 0.08, 0.03)


def box(builder: Builder, rng: Generator, frame: Frame, half: tuple[float, float, float], colour: Colour) -> None:
    """A closed cardboard box that stands on `frame`."""
    paint = Paint(Material.CARDBOARD, shade_of(rng, colour, 0.02, 0.008), int(rng.integers(1 << 16)))
    builder.object(frame, "box").cuboid((0, 0, half[2]), half, paint)


def pallet(
    builder: Builder, rng: Generator, frame: Frame, length: float = 1.2, width: float = 0.8, *, fine: bool = True
) -> None:
    """A wooden pallet: deck boards along x on blocks; a coarse one lacks what only a near look shows."""
    solid = builder.object(frame, "pallet")
    base = shade_of(rng, (1.0, 1.0, 1.0) if rng.random() < 0.85 else (0.75, 0.72, 0.7), 0.1, 0.03)

    def wood() -> Paint:
        return Paint(Material.WOOD, shade_of(rng, base, 0.04, 0.01), int(rng.integers(1 << 16)))

    boards = int(rng.integers(5, 8)) if fine else 5
    half_board = width / boards * 0.37
    for y in np.linspace(half_board - width / 2, width / 2 - half_board, boards):
        solid.cuboid((0, float(y), 0.133), (length / 2, half_board, 0.011), wood())
    for y in (0.05 - width / 2, 0, width / 2 - 0.05):
        solid.cuboid((0, y, 0.011), (length / 2, 0.05, 0.011), wood())
        for x in (0.07 - length / 2, 0, length / 2 - 0.07):
            solid.cuboid((x, y, 0.061), (0.07, 0.05, 0.039), wood())
    for x in (0.07 - length / 2, 0, length / 2 - 0.07) if fine else ():
        solid.cuboid((x, 0, 0.111), (0.07, width / 2, 0.011), wood())


def pallet_stack(builder: Builder, rng: Generator, frame: Frame) -> None:
    """Up to seven empty pallets on top of each other."""
    width = float(rng.choice([0.8, 1.0]))
    for level in range(int(rng.integers(1, 8)) if rng.random() < 0.4 else 1):
        x, y, yaw = rng.normal(0, (0.015, 0.015, 0.03))
        pallet(builder, rng, frame.at(x, y, level * DECK_HEIGHT, yaw), 1.2, width)


def load(builder: Builder, rng: Generator, frame: Frame, *, length: float, width: float, height: float) -> None:
    """Boxes in layers, at most `height` metres high, filling length x width; the top layer may have gaps."""
    columns, rows = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    colour = box_colour(rng)
    half_z = float(rng.uniform(0.09, 0.25))
    layers = max(1, int(rng.uniform(0.3, 1.0) * height / (2 * half_z)))
    pitch_x, pitch_y = length / columns, width / rows
    for layer, column, row in np.ndindex(layers, columns, rows):
        if layer == layers - 1 and columns * rows > 1 and rng.random() < 0.3:
            continue
        x, y = (column + 0.5) * pitch_x - length / 2, (row + 0.5) * pitch_y - width / 2
        x, y = x + rng.normal(0, 0.006), y + rng.normal(0, 0.006)
        half = (pitch_x * rng.uniform(0.45, 0.485), pitch_y * rng.uniform(0.45, 0.485), half_z * 0.99)
        place = frame.at(float(x), float(y), layer * 2 * half_z, float(rng.normal(0, 0.02)))
        box(builder, rng, place, half, colour)


def loaded_pallet(
    builder: Builder, rng: Generator, frame: Frame, height: float, *, fine: bool = True, width: float = 0.8
) -> None:
    """A pallet with a load on it."""
    pallet(builder, rng, frame, 1.2, width, fine=fine)
    load(builder, rng, frame.at(z=DECK_HEIGHT), length=1.15, width=width * 0.96, height=height)


def box_pile(builder: Builder, rng: Generator, frame: Frame) -> None:
    """One to three boxes on top of each other, sometimes with one beside them."""
    top = 0.0
    for level in range(int(rng.integers(1, 4))):
        shrink = 1 - 0.15 * level
        half = (rng.uniform(0.12, 0.36) * shrink, rng.uniform(0.12, 0.3) * shrink, rng.uniform(0.08, 0.28))
        x, y, yaw = rng.normal(0, (0.03, 0.03, 0.2))
        box(builder, rng, frame.at(x, y, top, yaw), half, box_colour(rng))
        top += 2 * half[2]
    if rng.random() < 0.4:
        half_x, half_y, half_z = rng.uniform(0.1, 0.26, 3)
        beside = frame.at(0, float(rng.choice([-0.72, 0.72])), 0, rng.uniform(-np.pi, np.pi))
        box(builder, rng, beside, (half_x, half_y, half_z), box_colour(rng))


BAY, DEPTH = 2.7, 0.55


def rack(builder: Builder, rng: Generator, frame: Frame, bays: int) -> None:
    """A pallet rack of `bays` bays along x, centred on `frame`, loaded at random on three levels."""
    uprights = [(0.12, 0.22, 0.5), (0.15, 0.4, 0.25), (0.42, 0.42, 0.44), (0.75, 0.3, 0.1)]
    beams = [(0.88, 0.4, 0.08), (0.88, 0.68, 0.1), (0.5, 0.5, 0.52)]
    steel = Paint(Material.METAL, shade_of(rng, uprights[int(rng.integers(4))]))
    orange = Paint(Material.METAL, shade_of(rng, beams[int(rng.integers(3))]))
    guard = Paint(Material.HAZARD, (1.0, 1.0, 1.0)) if rng.random() < 0.5 else None
    solid = builder.background(frame)
    for x in (np.arange(bays + 1) - bays / 2) * BAY:
        for y in (0.05 - DEPTH, DEPTH - 0.05):
            solid.cuboid((x, y, 2.2), (0.045, 0.045, 2.2), steel)
            if guard:
                solid.cuboid((x, y * 1.15, 0.2), (0.07, 0.06, 0.2), guard)
        for z in np.arange(0.4, 4.2, 1.2):
            solid.cuboid((x, 0, float(z)), (0.015, DEPTH, 0.02), steel)
    levels = [0.0, *np.cumsum(rng.uniform(1.2, 1.7, 2))]
    for bay in range(bays):
        middle = float((bay - bays / 2 + 0.5) * BAY)
        for level in levels:
            for y in (0.05 - DEPTH, DEPTH - 0.05) if level else ():
                solid.cuboid((middle, y, level - 0.06), (BAY / 2, 0.025, 0.06), orange)
            for side in (-0.66, 0.66):
                _rack_slot(builder, rng, frame.at(middle + side, 0, float(level), float(rng.normal(0, 0.02))))


def _rack_slot(builder: Builder, rng: Generator, frame: Frame) -> None:
    draw = rng.random()
    if draw < 0.4:
        loaded_pallet(builder, rng, frame, 0.95, fine=False, width=0.95)
    elif draw < 0.47:
        pallet(builder, rng, frame, 1.15, 0.95, fine=False)
    elif draw < 0.65:
        for x in np.linspace(-0.4, 0.4, int(rng.integers(1, 4))):
            half = (rng.uniform(0.12, 0.19), rng.uniform(0.12, 0.25), rng.uniform(0.08, 0.25))
            place = frame.at(float(x), rng.uniform(-0.15, 0.15), 0, float(rng.normal(0, 0.12)))
            box(builder, rng, place, half, box_colour(rng))


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
