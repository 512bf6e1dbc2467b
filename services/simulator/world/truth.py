"""Ground truth of a view: each visible object's mask, occlusion, distance and position. Exact."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from services.simulator.world.camera import Camera, Pose
from services.simulator.world.cuboids import BACKGROUND, CORNER_SIGNS, ClassName, Cuboids
from services.simulator.world.render import Geometry, render_geometry
from services.simulator.world.scene import Scene
from services.simulator.world.silhouette import Silhouette

Points = NDArray[np.float64]
MAP_UP: Final = (0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A box whose height runs along `up`, a unit vector, in some frame of reference.

    `centre` (3,) and `size` (length, width, height) are metres. `yaw` is radians from the frame's x axis, made level,
    to the length; counter-clockwise seen from above.
    """

    centre: Points
    size: Points
    yaw: float
    up: Points

    @classmethod
    def around(cls, points: Points, yaw: float) -> Self:
        """The smallest box of that yaw around map points (n, 3)."""
        axes = _axes(yaw, np.array(MAP_UP))
        local = points @ axes
        low, high = local.min(axis=0), local.max(axis=0)
        return cls(axes @ (low + high) / 2, high - low, yaw, np.array(MAP_UP))

    def clipped(self, points: Points) -> Points:
        """Points (n, 3) of the box's frame, those outside of it moved to its surface."""
        local = (points - self.centre) @ self.axes
        return np.asarray(np.clip(local, -self.size / 2, self.size / 2) @ self.axes.T + self.centre)

    @property
    def axes(self) -> Points:
        """The box's own axes in the frame, one each column: length, width, height."""
        return _axes(self.yaw, self.up)

    def corners(self) -> Points:
        """The corners (8, 3), in the order of `CORNER_SIGNS`."""
        return np.asarray(CORNER_SIGNS * self.size / 2 @ self.axes.T + self.centre)

    def seen_from(self, pose: Pose) -> Self:
        """The same box, of the map, in the frame that is at `pose`, whose x axis must not be upright."""
        rotation = pose.rotation.astype(np.float64)
        up, length = self.up @ rotation, self.axes[:, 0] @ rotation
        level = _axes(0.0, up)
        yaw = float(np.arctan2(length @ level[:, 1], length @ level[:, 0]))
        return type(self)((self.centre - pose.position) @ rotation, self.size, yaw, up)


def _axes(yaw: float, up: Points) -> Points:
    level = np.array([1.0, 0, 0]) - up[0] * up
    level /= np.linalg.norm(level)
    length = np.cos(yaw) * level + np.sin(yaw) * np.cross(up, level)
    return np.stack([length, np.cross(up, length), up], axis=1)


def parts_of(scene: Scene, instance: int) -> Cuboids:
    """The cuboids of an object."""
    return scene.cuboids.taken(np.flatnonzero(scene.cuboids.instances == instance))


def _heading(parts: Cuboids) -> float:
    """The yaw of an object's own axes: those of its first part."""
    x, y, _ = parts.rotations[0, :, 1].astype(np.float64)
    return float(np.arctan2(-x, y))


def box_of(parts: Cuboids) -> Box:
    """The upright box around a whole object in the map, along its own axes, however little of it is in view."""
    return Box.around(parts.corners().reshape(-1, 3).astype(np.float64), _heading(parts))


@dataclass(frozen=True, slots=True, eq=False)
class PresentObject:
    """An object of a scene, seen or not; `instance` and `box`, in the map, are as those of a `SeenObject`."""

    instance: int
    name: ClassName
    box: Box


def present_in(scene: Scene) -> tuple[PresentObject, ...]:
    """Every object that is there, by instance."""
    there = np.unique(scene.cuboids.instances).tolist()
    return tuple(
        PresentObject(instance, scene.class_name(instance), box_of(parts_of(scene, instance)))
        for instance in there
        if instance != BACKGROUND
    )


Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A scene, the viewpoint, and the output of an ideal camera."""

    scene: Scene
    pose: Pose
    camera: Camera
    geometry: Geometry


@dataclass(frozen=True, eq=False)
class SeenObject:
    """A visible object of a view; expensive values are computed on first use.

    `instance` is the same for the same object in every view of a scene. `mask` (rows, columns) is the window of its
    visible pixels whose upper left pixel is (`top`, `left`). Optical frame: x right, y down, z forward. Metres.
    """

    view: View
    instance: int
    name: ClassName
    top: int
    left: int
    mask: Mask

    @cached_property
    def pixels(self) -> int:
        """The number of its visible pixels."""
        return int(np.count_nonzero(self.mask))

    @property
    def image_share(self) -> float:
        """The share of the image's pixels that it is seen in."""
        return self.pixels / (self.view.camera.width * self.view.camera.height)

    def full_mask(self) -> Mask:
        """The mask of the whole image (height, width)."""
        full = np.zeros((self.view.camera.height, self.view.camera.width), np.bool_)
        rows, columns = self.mask.shape
        full[self.top : self.top + rows, self.left : self.left + columns] = self.mask
        return full

    @cached_property
    def visibility(self) -> float:
        """The visible share of the pixels that its faces would cover unoccluded on an endless image.

        1 if all of it is in view and nothing hides any of it.
        """
        outline = Silhouette.of(self._parts, self.view.pose, self.view.camera)
        return outline.visibility(self.full_mask(), self.view.geometry.depth)

    @cached_property
    def points(self) -> Points:
        """The points seen in its pixels (pixels, 3), row by row, in the optical frame."""
        rows, columns = np.nonzero(self.mask)
        rows, columns = rows + self.top, columns + self.left
        depth = self.view.geometry.depth[rows, columns].astype(np.float64)
        camera = self.view.camera
        return np.stack([(columns - camera.cx) / camera.fx * depth, (rows - camera.cy) / camera.fy * depth, depth], 1)

    @cached_property
    def depth_m(self) -> float:
        """The median distance along the optical axis."""
        return float(np.median(self.points[:, 2]))

    @cached_property
    def distance_m(self) -> float:
        """The median straight distance from the camera's centre."""
        return float(np.median(np.linalg.norm(self.points, axis=1)))

    @cached_property
    def centroid(self) -> Points:
        """The mean of the points seen in its pixels, in the optical frame (3,)."""
        return np.asarray(self.points.mean(axis=0))

    @property
    def centroid_in_map(self) -> Points:
        """The same point in the map."""
        return self.view.pose.to_map(self.centroid)

    @cached_property
    def box(self) -> Box:
        """The upright box around the whole object, in the map; `box.seen_from(pose)` is that in the optical frame."""
        return box_of(self._parts)

    @cached_property
    def visible_box(self) -> Box:
        """The upright box in the map, along the object's own axes, around what is seen of it."""
        return Box.around(self.box.clipped(self.view.pose.to_map(self.points)), self.box.yaw)

    @cached_property
    def _parts(self) -> Cuboids:
        return parts_of(self.view.scene, self.instance)


def truth(scene: Scene, pose: Pose, camera: Camera, *, least_pixels: int = 1) -> tuple[SeenObject, ...]:
    """Every object of which at least so many pixels are visible, by instance."""
    return truth_of(scene, render_geometry(scene, pose, camera), pose, camera, least_pixels=least_pixels)


def truth_of(
    scene: Scene, geometry: Geometry, pose: Pose, camera: Camera, *, least_pixels: int = 1
) -> tuple[SeenObject, ...]:
    """The same for a view that is rendered already."""
    view = View(scene, pose, camera, geometry)
    instances = geometry.instances
    places = np.flatnonzero(instances != BACKGROUND)
    owners = instances.ravel()[places]
    order = np.argsort(owners.astype(np.uint16), kind="stable")  # stable sorting of 16 bits is by radix
    present, starts, counts = np.unique(owners[order], return_index=True, return_counts=True)
    found = []
    for instance, start, count in zip(present.tolist(), starts, counts, strict=True):
        if count >= least_pixels:
            own = places[order[start : start + count]]
            found.append(_seen(view, instance, own))
    return tuple(found)


def _seen(view: View, instance: int, places: NDArray[np.intp]) -> SeenObject:
    rows, columns = np.divmod(places, view.camera.width)
    top, left = int(rows[0]), int(columns.min())
    mask = np.zeros((int(rows[-1]) - top + 1, int(columns.max()) - left + 1), np.bool_)
    mask[rows - top, columns - left] = True
    return SeenObject(view, instance, view.scene.class_name(instance), top, left, mask)
