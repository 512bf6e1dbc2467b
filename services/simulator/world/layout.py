"""Procedural warehouses: racks along the aisles, goods, trucks and clutter on the free floor."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.random import Generator

from services.simulator.world.cuboids import CLASSES, Builder, Frame, Material, Paint
from services.simulator.world.floor import paint_floor
from services.simulator.world.forklifts import forklift
from services.simulator.world.props import BAY, Colour, box_pile, clutter, loaded_pallet, pallet_stack, rack, shade_of
from services.simulator.world.scene import Movable, Scene
from services.simulator.world.surfaces import Lighting, surfaces_of
from services.simulator.world.textures import atlas

HEIGHT: Final = 6.0
WALL_COLOURS: tuple[Colour, ...] = (
    (0.78, 0.78, 0.75),
    (0.55, 0.6, 0.65),
    (0.66, 0.52, 0.42),
    (0.85, 0.84, 0.78),
    (0.5, 0.58, 0.5),
)
Maker = Callable[[Builder, Generator, Frame], None]


def generate(seed: int) -> Scene:
    """The warehouse of `seed`: always the same one."""
    rng = np.random.default_rng([seed, 1])
    half_x, half_y = float(rng.uniform(7.0, 11.0)), float(rng.uniform(6.0, 9.0))
    builder = Builder()
    _hall(builder, rng, half_x, half_y)
    ground = _Ground(rng, half_x, half_y)
    _racks(builder, rng, ground)
    kinds: tuple[tuple[Maker, int, int, float], ...] = (
        (forklift, 1, 5, 1.45),
        (_floor_load, 2, 6, 0.75),
        (pallet_stack, 2, 6, 0.75),
        (box_pile, 3, 9, 0.5),
        (clutter, 1, 7, 0.5),
    )
    movables = []
    for maker, least, most, radius in kinds:
        for _ in range(int(rng.integers(least, most))):
            frame = ground.place(radius)
            if frame is not None:
                first = builder.instances
                maker(builder, rng, frame)
                if builder.instances > first:
                    name = CLASSES[builder.instance_classes[first]]
                    movables.append(Movable(range(first, builder.instances), name, frame))
    return replace(_finish(seed, rng, builder, half_x, half_y), movables=tuple(movables))


def _finish(seed: int, rng: Generator, builder: Builder, half_x: float, half_y: float) -> Scene:
    cuboids = builder.cuboids()
    lighting = Lighting.draw(rng, half_x, half_y)
    return Scene(
        seed=seed,
        half_x=half_x,
        half_y=half_y,
        cuboids=cuboids,
        instance_classes=np.asarray(builder.instance_classes, np.int32),
        lighting=lighting,
        floor=paint_floor(rng, cuboids, lighting, half_x, half_y),
        surfaces=surfaces_of(cuboids, lighting, atlas()),
    )


def _hall(builder: Builder, rng: Generator, half_x: float, half_y: float) -> None:
    solid = builder.background(Frame())
    reach_x, reach_y = half_x + 0.2, half_y + 0.2
    solid.cuboid((0, 0, -0.1), (reach_x, reach_y, 0.1), Paint(Material.FLOOR, (1, 1, 1), int(rng.integers(1 << 16))))
    colour = shade_of(rng, WALL_COLOURS[int(rng.integers(len(WALL_COLOURS)))])
    wall = Paint(Material.WALL, colour, int(rng.integers(1 << 16)))
    band_paint = shade_of(rng, (colour, (0.3, 0.35, 0.45), (0.75, 0.65, 0.2))[int(rng.integers(3))])
    band = Paint(Material.PLAIN, band_paint)
    for x, y, long_x, long_y in ((1, 0, 0, 1), (-1, 0, 0, 1), (0, 1, 1, 0), (0, -1, 1, 0)):
        centre = (x * (half_x + 0.1), y * (half_y + 0.1), HEIGHT / 2)
        solid.cuboid(centre, (reach_x * long_x + 0.1, reach_y * long_y + 0.1, HEIGHT / 2 + 0.2), wall)
        skirting = (x * half_x, y * half_y, 0.5)
        solid.cuboid(skirting, (half_x * long_x + 0.02, half_y * long_y + 0.02, 0.5), band)
    roof = Paint(Material.CEILING, (1, 1, 1), int(rng.integers(2)))
    solid.cuboid((0, 0, HEIGHT + 0.1), (reach_x, reach_y, 0.1), roof)
    for beam in np.arange(2 - half_x, half_x, 4.0):
        solid.cuboid((float(beam), 0, HEIGHT - 0.25), (0.1, half_y, 0.2), Paint(Material.METAL, (0.45, 0.46, 0.5)))


def _racks(builder: Builder, rng: Generator, ground: "_Ground") -> None:
    rows = rng.permutation([0.95 - ground.half_y, 0.0, ground.half_y - 0.95])
    for y in rows[: int(rng.integers(1, 4))]:
        bays = int(rng.integers(2, 5))
        x = float(rng.uniform(-1.5, 1.5))
        rack(builder, rng, Frame(x, float(y), 0, np.pi * (y > 0)), bays)
        ground.block(x, float(y), bays * BAY / 2 + 0.3, 0.9)


def _floor_load(builder: Builder, rng: Generator, frame: Frame) -> None:
    loaded_pallet(builder, rng, frame, float(rng.uniform(0.3, 1.6)), width=float(rng.choice([0.8, 1.0])))


@dataclass(slots=True)
class _Ground:
    """Keeps things on the floor apart."""

    rng: Generator
    half_x: float
    half_y: float
    _rectangles: list[tuple[float, float, float, float]] = field(default_factory=list)
    _discs: list[tuple[float, float, float]] = field(default_factory=list)

    def block(self, x: float, y: float, half_x: float, half_y: float) -> None:
        self._rectangles.append((x, y, half_x, half_y))

    def place(self, radius: float) -> Frame | None:
        """A free spot for a thing of `radius` metres, or None when the floor is full."""
        margin = radius + 0.2
        for _ in range(60):
            x = float(self.rng.uniform(margin - self.half_x, self.half_x - margin))
            y = float(self.rng.uniform(margin - self.half_y, self.half_y - margin))
            if self._is_free(x, y, radius):
                self._discs.append((x, y, radius))
                return Frame(x, y, 0.0, self._heading())
        return None

    def _is_free(self, x: float, y: float, radius: float) -> bool:
        clear = all(abs(x - a) > w + radius or abs(y - b) > h + radius for a, b, w, h in self._rectangles)
        return clear and all(np.hypot(x - a, y - b) > other + radius for a, b, other in self._discs)

    def _heading(self) -> float:
        if self.rng.random() < 0.4:
            return float(self.rng.choice([0, np.pi / 2, np.pi, -np.pi / 2]) + self.rng.normal(0, 0.08))
        return float(self.rng.uniform(-np.pi, np.pi))
