"""A whole warehouse: its cuboids, its objects, its light; and the same with movable things in other places."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.simulator.world.cuboids import CLASSES, ClassName, Cuboids, Floats, Frame
from services.simulator.world.floor import Floor
from services.simulator.world.surfaces import Lighting, Surfaces, surfaces_of
from services.simulator.world.textures import atlas


@dataclass(frozen=True, slots=True)
class Movable:
    """Something on the floor with all that is on it, at `frame`: its objects are `instances`, the first of `name`."""

    instances: range
    name: ClassName
    frame: Frame


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A hall of 2 * half_x by 2 * half_y metres around the map's origin.

    `instance_classes[i]` is the index in `CLASSES` of instance i, and -1 for instance 0, the background.
    Cuboid 0 is the floor. `movables` are what can be moved: goods on the floor, and forklifts.
    """

    seed: int
    half_x: float
    half_y: float
    cuboids: Cuboids
    instance_classes: NDArray[np.int32]
    lighting: Lighting
    floor: Floor
    surfaces: Surfaces
    movables: tuple[Movable, ...] = ()

    def class_name(self, instance: int) -> ClassName:
        """The name of an object's class. Raises ValueError for the background."""
        index = int(self.instance_classes[instance])
        if index < 0:
            raise ValueError("the background has no class")
        return CLASSES[index]

    def instance_centres(self) -> Floats:
        """The centre of each instance's bounding box, (instances, 3), NaN for the background."""
        centres = np.full((len(self.instance_classes), 3), np.nan, np.float32)
        corners = self.cuboids.corners()
        order = np.argsort(self.cuboids.instances, kind="stable")
        owners = self.cuboids.instances[order]
        starts = np.flatnonzero(np.r_[True, owners[1:] != owners[:-1]])
        low = np.minimum.reduceat(corners.min(axis=1)[order], starts)
        high = np.maximum.reduceat(corners.max(axis=1)[order], starts)
        centres[owners[starts]] = (low + high) / 2
        centres[0] = np.nan
        return centres


Places = Mapping[int, Frame | None]
"""Where movables are that are not where the scene has them, by number: a frame on the floor, or None for away."""


def arranged(scene: Scene, places: Places) -> Scene:
    """The scene with its movables elsewhere; they are lit, and shade the floor, where they are."""
    if not places:
        return scene
    cuboids = arranged_cuboids(scene, places)
    return replace(
        scene,
        cuboids=cuboids,
        floor=scene.floor.under(cuboids),
        surfaces=surfaces_of(cuboids, scene.lighting, atlas()),
    )


def arranged_cuboids(scene: Scene, places: Places) -> Cuboids:
    """The cuboids of `arranged`, in the order of the scene's."""
    found = scene.cuboids
    centres, rotations = found.centres.copy(), found.rotations.copy()
    there = np.ones(len(found), np.bool_)
    for number, place in places.items():
        movable = scene.movables[number]
        rows = rows_of(scene, movable)
        if place is None:
            there[rows] = False
        else:
            turn = rotation(place.yaw - movable.frame.yaw)
            at_home = found.centres[rows] - _on_floor(movable.frame)
            centres[rows] = at_home @ turn.T + _on_floor(place)
            rotations[rows] = turn @ found.rotations[rows]
    return replace(found, centres=centres, rotations=rotations).taken(np.flatnonzero(there))


def rows_of(scene: Scene, movable: Movable) -> NDArray[np.intp]:
    """The rows of a movable's cuboids in its scene."""
    owners = scene.cuboids.instances
    return np.flatnonzero((owners >= movable.instances.start) & (owners < movable.instances.stop))


def rotation(yaw: float) -> NDArray[np.float32]:
    """The matrix (3, 3) of a turn about the vertical."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], np.float32)


def _on_floor(frame: Frame) -> NDArray[np.float32]:
    return np.array([frame.x, frame.y, 0], np.float32)


def outline_of(scene: Scene, movable: Movable) -> NDArray[np.float64]:
    """The rectangle around a movable seen from above, in its own frame: low and high corner (2, 2) in metres."""
    corners = scene.cuboids.taken(rows_of(scene, movable)).corners().reshape(-1, 3).astype(np.float64)
    local = (corners - [movable.frame.x, movable.frame.y, 0]) @ rotation(movable.frame.yaw).astype(np.float64)
    return np.stack([local[:, :2].min(axis=0), local[:, :2].max(axis=0)])
