"""Builds all objects of the world from oriented cuboids, and stores them."""

from dataclasses import dataclass, field, fields
from enum import IntEnum
from typing import Final, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float32]
ClassName = Literal["box", "pallet", "forklift"]
CLASSES: Final[tuple[ClassName, ...]] = ("box", "pallet", "forklift")
BACKGROUND: Final = 0

CORNER_SIGNS: Final = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)


class Material(IntEnum):
    """The material of a cuboid's faces; each has textures in the atlas."""

    PLAIN = 0
    METAL = 1
    CARDBOARD = 2
    WOOD = 3
    HAZARD = 4
    FLOOR = 5
    WALL = 6
    CEILING = 7


@dataclass(frozen=True, slots=True)
class Paint:
    """A material with its colour (sRGB, 0 to 1); `variant` picks one of the material's textures."""

    material: Material
    colour: tuple[float, float, float]
    variant: int = 0


@dataclass(frozen=True, slots=True)
class Frame:
    """A place on some horizontal surface: metres, and radians about the vertical."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    yaw: float = 0.0

    def at(self, x: float = 0.0, y: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Self:
        """The frame that lies at (x, y, z, yaw) as seen from this one."""
        cos, sin = float(np.cos(self.yaw)), float(np.sin(self.yaw))
        return type(self)(self.x + cos * x - sin * y, self.y + sin * x + cos * y, self.z + z, self.yaw + yaw)


@dataclass(frozen=True, slots=True, eq=False)
class Cuboids:
    """N oriented cuboids, one row each, in the map frame.

    A column of `rotations[k]` is one of cuboid k's axes; the second one is always horizontal.
    """

    centres: Floats
    rotations: Floats
    half_extents: Floats
    colours: Floats
    materials: NDArray[np.intp]
    variants: NDArray[np.intp]
    instances: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.centres)

    def taken(self, rows: NDArray[np.intp]) -> Self:
        """Select cuboids, in the order of `rows`."""
        return type(self)(*(getattr(self, column.name)[rows] for column in fields(self)))

    def corners(self) -> Floats:
        """The corners in the map frame, (N, 8, 3), in the order of `CORNER_SIGNS`."""
        local = CORNER_SIGNS * self.half_extents[:, None]
        return np.asarray(local @ self.rotations.transpose(0, 2, 1) + self.centres[:, None], np.float32)


@dataclass(slots=True)
class Builder:
    """Collects cuboids and hands out instance numbers: 0 is background, objects count from 1."""

    instance_classes: list[int] = field(default_factory=lambda: [-1])
    _centres: list[Floats] = field(default_factory=list)
    _rotations: list[Floats] = field(default_factory=list)
    _half_extents: list[ArrayLike] = field(default_factory=list)
    _paints: list[Paint] = field(default_factory=list)
    _instances: list[int] = field(default_factory=list)

    @property
    def instances(self) -> int:
        """The number of instances so far, the background included."""
        return len(self.instance_classes)

    def object(self, frame: Frame, name: ClassName) -> "Solid":
        """Start a new instance of class `name` at `frame`."""
        self.instance_classes.append(CLASSES.index(name))
        return Solid(self, frame, len(self.instance_classes) - 1)

    def background(self, frame: Frame) -> "Solid":
        """Start something that is not an object of interest."""
        return Solid(self, frame, BACKGROUND)

    def add(self, centre: Floats, rotation: Floats, half: ArrayLike, paint: Paint, instance: int) -> None:
        self._centres.append(centre)
        self._rotations.append(rotation)
        self._half_extents.append(half)
        self._paints.append(paint)
        self._instances.append(instance)

    def cuboids(self) -> Cuboids:
        """All added cuboids."""
        return Cuboids(
            centres=np.asarray(self._centres, np.float32),
            rotations=np.asarray(self._rotations, np.float32),
            half_extents=np.asarray(self._half_extents, np.float32),
            colours=np.asarray([p.colour for p in self._paints], np.float32),
            materials=np.asarray([p.material for p in self._paints], np.intp),
            variants=np.asarray([p.variant for p in self._paints], np.intp),
            instances=np.asarray(self._instances, np.int32),
        )


@dataclass(frozen=True, slots=True)
class Solid:
    """An object under construction, in its own frame."""

    builder: Builder
    frame: Frame
    instance: int

    def cuboid(
        self,
        centre: tuple[float, float, float],
        half: tuple[float, float, float],
        paint: Paint,
        pitch: float = 0.0,
        yaw: float = 0.0,
    ) -> None:
        """Add one cuboid, turned by `pitch` about its own y axis and then by `yaw` about the vertical."""
        place = self.frame.at(*centre, yaw)
        position = np.array([place.x, place.y, place.z], np.float32)
        cos, sin = np.cos(place.yaw), np.sin(place.yaw)
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        cos, sin = np.cos(pitch), np.sin(pitch)
        tilt = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
        self.builder.add(position, (turn @ tilt).astype(np.float32), half, paint, self.instance)

    def wheel(self, centre: tuple[float, float, float], radius: float, half_width: float, paint: Paint) -> None:
        """Add an octagonal wheel that rolls along the x axis."""
        apothem, half_side = radius * 0.924, radius * 0.383
        for step in range(4):
            self.cuboid(centre, (apothem, half_width, half_side), paint, pitch=step * np.pi / 4)
