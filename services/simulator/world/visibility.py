"""Finds the visible face of each pixel: a z-buffer of planar faces with inverse depth affine in the pixel."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.simulator.world.camera import Camera, Pose
from services.simulator.world.cuboids import Cuboids, Floats
from services.simulator.world.surfaces import RINGS

NEAR: Final = 0.05
SUBPIXEL_BITS: Final = 8


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """`slots` (height, width) indexes `faces`, -1 where nothing is; `inverse_depth` (height, width) is 1/m."""

    faces: NDArray[np.intp]
    slots: NDArray[np.int32]
    inverse_depth: Floats
    planes: Floats


def find_visible(cuboids: Cuboids, pose: Pose, camera: Camera) -> Visibility:
    """Draw the faces that look towards the camera, nearest first."""
    faces, rings = facing_rings(cuboids, pose)
    ahead = _in_view(rings, camera)
    faces, rings = faces[ahead], rings[ahead]
    polygons = project(rings, camera)
    corners, firsts = np.concatenate([*polygons, np.empty((0, 2), np.float32)]), np.cumsum([0, *map(len, polygons)])
    low, high = (extreme.reduceat(corners, firsts[:-1]) for extreme in (np.minimum, np.maximum))
    size = (camera.width, camera.height)
    inside = ((high > -0.5) & (low < np.subtract(size, 0.5))).all(axis=1)
    kept = np.flatnonzero(inside)
    kept = kept[np.argsort(rings[kept, :, 2].min(axis=1), kind="stable")]
    starts = np.clip(np.floor(low[kept]), 0, size).astype(int)
    ends = np.clip(np.ceil(high[kept]) + 1, 0, size).astype(int)
    planes = planes_of(rings[kept], camera)
    slots = _draw([polygons[i] for i in kept], starts, ends, planes, camera)
    nearest = (1 / np.maximum(rings[kept, :, 2].min(axis=1), NEAR)).astype(np.float32)
    return Visibility(faces[kept], slots, _inverse_depth(slots, planes, nearest), planes)


def toward(cuboids: Cuboids, position: Floats) -> NDArray[np.bool_]:
    """Mask of faces (cuboids, 6) turned towards a point of the map."""
    viewer = np.einsum("kij,ki->kj", cuboids.rotations, position - cuboids.centres)
    return np.stack([viewer < -cuboids.half_extents, viewer > cuboids.half_extents], axis=2).reshape(-1, 6)


def facing_rings(cuboids: Cuboids, pose: Pose) -> tuple[NDArray[np.intp], Floats]:
    """The faces turned to the camera and at least partly before it, with their corners in the optical frame."""
    facing = toward(cuboids, pose.position)
    corners = (cuboids.corners() - pose.position) @ pose.rotation
    cuboid, face = np.nonzero(facing & (corners[..., 2].max(axis=1) > NEAR)[:, None])
    rings = corners[cuboid[:, None], RINGS[face]]
    before = rings[..., 2].max(axis=1) > NEAR
    return (cuboid * 6 + face)[before], rings[before]


def _in_view(rings: Floats, camera: Camera) -> NDArray[np.bool_]:
    """Mask of rings that are not wholly beyond one border of the image, give or take a pixel."""
    x, y, z = np.moveaxis(rings, -1, 0)
    right, down = camera.fx * x + np.float32(camera.cx) * z, camera.fy * y + np.float32(camera.cy) * z
    beyond = np.stack([right < -z, right > camera.width * z, down < -z, down > camera.height * z])
    return np.asarray(~beyond.all(axis=2).any(axis=0), np.bool_)


def project(rings: Floats, camera: Camera) -> list[Floats]:
    """Image polygons of the rings, cut off at the near plane."""
    focal, centre = np.array([camera.fx, camera.fy], np.float32), np.array([camera.cx, camera.cy], np.float32)
    whole = rings[..., :2] / np.maximum(rings[..., 2:], NEAR) * focal + centre
    polygons = list(whole)
    for index in np.flatnonzero(rings[..., 2].min(axis=1) < NEAR):
        cut = _clip(rings[index])
        polygons[index] = cut[:, :2] / cut[:, 2:] * focal + centre
    return polygons


def _clip(ring: Floats) -> Floats:
    points = []
    for here, there in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        if here[2] >= NEAR:
            points.append(here)
        if (here[2] >= NEAR) != (there[2] >= NEAR):
            points.append(here + (there - here) * ((NEAR - here[2]) / (there[2] - here[2])))
    return np.asarray(points, np.float32)


def planes_of(rings: Floats, camera: Camera) -> Floats:
    """(a, b, c) of each face, with 1 / depth = a * column + b * row + c."""
    normals = np.cross(rings[:, 1] - rings[:, 0], rings[:, 3] - rings[:, 0]).astype(np.float64)
    scaled = normals / np.sum(normals * rings[:, 0], axis=1, keepdims=True)
    return to_pixels(scaled, camera)


def to_pixels(directions: NDArray[np.floating], camera: Camera) -> Floats:
    """Turn (..., 3) factors of a viewing ray (x, y, 1) into factors of (column, row, 1)."""
    a, b = directions[..., 0] / camera.fx, directions[..., 1] / camera.fy
    c = directions[..., 2] - a * camera.cx - b * camera.cy
    return np.stack([a, b, c], axis=-1).astype(np.float32)


def _draw(
    polygons: list[Floats],
    starts: NDArray[np.int_],
    ends: NDArray[np.int_],
    planes: Floats,
    camera: Camera,
) -> NDArray[np.int32]:
    shape = (camera.height, camera.width)
    slots, buffer = np.full(shape, -1, np.int32), np.zeros(shape, np.float32)
    columns, rows = np.arange(camera.width, dtype=np.float32), np.arange(camera.height, dtype=np.float32)[:, None]
    scale = 1 << SUBPIXEL_BITS
    for slot, (polygon, (x0, y0), (x1, y1), (a, b, c)) in enumerate(zip(polygons, starts, ends, planes, strict=True)):
        covered = np.zeros((y1 - y0, x1 - x0), np.uint8)
        outline = ((polygon - (x0, y0)) * scale).astype(np.int32)
        cv2.fillConvexPoly(covered, outline, 1, cv2.LINE_8, SUBPIXEL_BITS)
        # An outline's pixels reach half a pixel beyond the face, where a grazing plane must not win.
        candidate = a * columns[x0:x1] + (b * rows[y0:y1] + (c - (abs(a) + abs(b)) / 2))
        window = buffer[y0:y1, x0:x1]
        nearer = (candidate > window) & covered.view(np.bool_)
        np.copyto(window, candidate, where=nearer)
        np.copyto(slots[y0:y1, x0:x1], slot, where=nearer)
    return slots


def _inverse_depth(slots: NDArray[np.int32], planes: Floats, nearest: Floats) -> Floats:
    """Inverse depth of each pixel's own face, 0 where there is none."""
    rows, columns = (np.arange(size, dtype=np.float32) for size in slots.shape)
    a, b, c = np.append(planes, [[0, 0, 0]], axis=0).astype(np.float32).T.copy()
    depth = np.take(a, slots, mode="wrap") * columns + np.take(b, slots, mode="wrap") * rows[:, None]
    depth += np.take(c, slots, mode="wrap")
    return np.minimum(depth, np.take(np.append(nearest, np.float32(0)), slots, mode="wrap"))
