"""A spinning lidar: the first face each ray meets, and the returns a real sensor reports."""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from services.simulator.world.camera import Pose
from services.simulator.world.cuboids import Cuboids, Floats
from services.simulator.world.scene import Scene
from services.simulator.world.silhouette import ramp
from services.simulator.world.visibility import toward

Doubles = NDArray[np.float64]
FULL_CIRCLE: Final = 2 * np.pi
PERCENT: Final = 100.0


@dataclass(frozen=True, slots=True)
class Lidar:
    """A lidar's rays: one for each of `elevations` (radians, lowest first) in each of `columns` even steps of a turn.

    Column k looks k steps to the left of the sensor's x axis. Ranges are metres, `noise` the standard deviation of one.
    The defaults are those of a Velodyne VLP-16 (user manual 63-9243): 16 rings from -15 to 15 degrees, 0.2 degrees a
    step at 10 turns a second, up to 100 m with an accuracy of typically 3 cm.
    """

    elevations: tuple[float, ...] = tuple(np.radians(np.linspace(-15, 15, 16)).tolist())
    columns: int = 1800
    least: float = 0.5
    greatest: float = 100.0
    noise: float = 0.015

    @classmethod
    def with_rings(cls, count: int, lowest: float, highest: float) -> Self:
        """A lidar of `count` even rings between two elevations in radians."""
        return cls(elevations=tuple(np.linspace(lowest, highest, count).tolist()))

    def directions(self) -> Doubles:
        """The unit vectors of all rays in the sensor's frame (x ahead, y left, z up), (rings, columns, 3)."""
        up, around = np.asarray(self.elevations)[:, None], np.arange(self.columns) * (FULL_CIRCLE / self.columns)
        level = np.cos(up)
        return np.stack(np.broadcast_arrays(level * np.cos(around), level * np.sin(around), np.sin(up)), axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """The returns of one turn, ring by ring: n points.

    `xyz` (n, 3) is metres in the sensor's frame (x ahead, y left, z up), `intensity` percent of a white surface's, seen
    squarely. `ring` counts from the lowest. `instances` is the truth: the scene's numbers, 0 for the background.
    """

    xyz: Floats
    intensity: Floats
    ring: NDArray[np.uint16]
    instances: NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """Exact ranges in metres (rings, columns), infinite where nothing is, and the face hit (6 * cuboid + f, or -1)."""

    ranges: Doubles
    faces: NDArray[np.int64]


def turn(scene: Scene, pose: Pose, lidar: Lidar, rng: Generator) -> Turn:
    """One turn of a `lidar` whose own frame (x ahead, y left, z up) is at `pose`."""
    hits = cast(scene.cuboids, pose, lidar)
    measured = hits.ranges + rng.normal(0, lidar.noise, hits.ranges.shape)
    ring, column = np.nonzero((measured >= lidar.least) & (measured <= lidar.greatest))
    directions = lidar.directions()[ring, column]
    faces = hits.faces[ring, column]
    facing = np.abs(np.einsum("nx,nx->n", scene.surfaces.normals[faces] @ pose.rotation, directions))
    reflected = np.minimum(scene.surfaces.tints[faces].mean(axis=1), 1) * facing
    return Turn(
        xyz=(directions * measured[ring, column, None]).astype(np.float32),
        intensity=(PERCENT * reflected).astype(np.float32),
        ring=ring.astype(np.uint16),
        instances=scene.cuboids.instances[faces // 6],
    )


def cast(cuboids: Cuboids, pose: Pose, lidar: Lidar) -> Hits:
    """Follow every ray of `lidar` to the first face.

    In a column a ray is (cos a, sin a, t) with its slope t, in which everything is linear: so each face is hit by one
    interval of slopes, and that is one run of rings.
    """
    faces = _Faces.of(cuboids, pose)
    face, column = faces.columns(lidar.columns)
    slopes = np.tan(np.asarray(lidar.elevations))
    low, high, level, rise = faces.intervals(face, np.asarray(column * (FULL_CIRCLE / lidar.columns), np.float64))
    first, last = np.searchsorted(slopes, low, "left"), np.searchsorted(slopes, high, "right")
    counts = np.maximum(last - first, 0)
    each = np.repeat(np.arange(len(face)), counts)
    ring = first[each] + ramp(counts)
    inverse, cell = level[each] + rise[each] * slopes[ring], ring * lidar.columns + column[each]
    nearest = np.zeros(len(slopes) * lidar.columns)
    np.maximum.at(nearest, cell, inverse)
    found = np.full(len(nearest), -1)
    won = (inverse == nearest[cell]) & (inverse > 0)
    found[cell[won]] = faces.numbers[face[each[won]]]
    ranges = np.divide(1, nearest, out=np.full_like(nearest, np.inf), where=nearest > 0).reshape(len(slopes), -1)
    return Hits(ranges * np.sqrt(1 + slopes**2)[:, None], found.reshape(ranges.shape))


@dataclass(frozen=True, slots=True, eq=False)
class _Faces:
    """The faces turned to the sensor, in its frame.

    For a ray d, `normals @ d` is the inverse of how many lengths of d the face's plane is away, and the ray meets the
    face itself if neither of `spans @ d` is greater than that.
    """

    numbers: NDArray[np.int64]
    normals: Doubles
    spans: Doubles
    corners: Doubles

    @classmethod
    def of(cls, cuboids: Cuboids, pose: Pose) -> Self:
        rotation = pose.rotation.astype(np.float64)
        cuboid, side = np.nonzero(toward(cuboids, pose.position))
        axis, sign = side // 2, np.where(side % 2, 1.0, -1.0)
        axes = np.einsum("nij,ik->njk", cuboids.rotations[cuboid].astype(np.float64), rotation)
        halves = cuboids.half_extents[cuboid].astype(np.float64)
        rows = np.arange(len(cuboid))
        first, second = (axis + 1) % 3, (axis + 2) % 3
        outward = axes[rows, axis] * sign[:, None]
        middle = (cuboids.centres[cuboid] - pose.position).astype(np.float64) @ rotation
        middle += outward * halves[rows, axis, None]
        normals = outward / np.einsum("nx,nx->n", outward, middle)[:, None]
        sides = np.stack([axes[rows, first], axes[rows, second]], axis=1)
        reach = np.stack([halves[rows, first], halves[rows, second]], axis=1)[..., None]
        offsets = np.einsum("nsx,nx->ns", sides, middle)[..., None]
        one, other = (sides * reach)[:, 0], (sides * reach)[:, 1]
        corners = middle[:, None] + np.stack([one + other, one - other, -one - other, other - one], axis=1)
        return cls(cuboid * 6 + side, normals, (sides - offsets * normals[:, None]) / reach, corners)

    def columns(self, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Every face with every column of rays that may meet it, of `count` around."""
        x, y = self.corners[..., 0], self.corners[..., 1]
        angles = np.arctan2(y, x)
        turns = (angles - angles[:, :1] + np.pi) % FULL_CIRCLE - np.pi
        beside = x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)
        around = (beside >= 0).all(axis=1) | (beside <= 0).all(axis=1) | (np.ptp(turns, axis=1) >= np.pi)
        step = FULL_CIRCLE / count
        first = np.where(around, 0, np.floor((angles[:, 0] + turns.min(axis=1)) / step)).astype(np.int64)
        last = np.where(around, count - 1, np.ceil((angles[:, 0] + turns.max(axis=1)) / step)).astype(np.int64)
        lengths = last - first + 1
        faces = np.repeat(np.arange(len(first)), lengths)
        return faces, (first[faces] + ramp(lengths)) % count

    def intervals(self, face: NDArray[np.int64], angle: Doubles) -> tuple[Doubles, Doubles, Doubles, Doubles]:
        """The slopes between which rays at `angle` meet the face; their inverse distance at slope 0, and its rise."""
        cos, sin = np.cos(angle), np.sin(angle)
        low, high = np.full(len(face), -np.inf), np.full(len(face), np.inf)
        level, rise = _along(self.normals[face], cos, sin)
        for span in (self.spans[:, 0], self.spans[:, 1]):
            across, climb = _along(span[face], cos, sin)
            for sign in (-1, 1):
                room, slope = level + sign * across, rise + sign * climb  # met where room + slope * t >= 0
                with np.errstate(divide="ignore", invalid="ignore"):
                    edge = -room / slope
                np.maximum(low, np.where(slope > 0, edge, -np.inf), out=low)
                np.minimum(high, np.where(slope < 0, edge, np.inf), out=high)
                high[(slope == 0) & (room < 0)] = -np.inf
        return low, high, level, rise


def _along(vectors: Doubles, cos: Doubles, sin: Doubles) -> tuple[Doubles, Doubles]:
    return vectors[:, 0] * cos + vectors[:, 1] * sin, vectors[:, 2]
