"""The light of a hall, and the constant data of every face of a scene: its plane, texture and light."""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from services.simulator.world.cuboids import CORNER_SIGNS, Cuboids, Floats, Material
from services.simulator.world.textures import SIZE, TILE_METRES, Atlas


@dataclass(frozen=True, slots=True, eq=False)
class Lighting:
    """Lights of one hall. `direction` points to the strongest light; lamps are points in the map frame."""

    ambient: float
    direction: Floats
    strength: float
    lamps: Floats
    lamp_strengths: Floats

    @classmethod
    def draw(cls, rng: Generator, half_x: float, half_y: float) -> Self:
        """A random lighting for a hall of the given half extents."""
        direction = rng.normal(0, 1, 3)
        direction[2] = abs(direction[2]) + 0.5
        count = int(rng.integers(2, 6))
        spread = np.array([half_x, half_y, 1.0]) * 0.8
        lamps = rng.uniform(-1, 1, (count, 3)) * spread + [0, 0, 4.8]
        return cls(
            ambient=float(rng.uniform(0.3, 0.6)),
            direction=(direction / np.linalg.norm(direction)).astype(np.float32),
            strength=float(rng.uniform(0.05, 0.45)),
            lamps=lamps.astype(np.float32),
            lamp_strengths=rng.uniform(0.1, 0.7, count).astype(np.float32),
        )

    def on(self, points: Floats, normals: Floats) -> Floats:
        """Light on `points` (..., 3) of surfaces with unit `normals` (..., 3): about 1 is well lit."""
        light = self.ambient * (0.72 + 0.28 * normals[..., 2])
        light = light + self.strength * np.maximum(normals @ self.direction, 0)
        for lamp, strength in zip(self.lamps, self.lamp_strengths, strict=True):
            towards = lamp - points
            squared = np.sum(towards * towards, axis=-1)
            facing = np.maximum(np.sum(towards * normals, axis=-1), 0) / np.sqrt(squared)
            light = light + strength * facing / (1 + 0.05 * squared)
        return np.asarray(light, np.float32)


# Face 2 * axis + (sign > 0): its corners in ring order, and the two axes that span it.
RINGS: Final = np.array(
    [np.flatnonzero(CORNER_SIGNS[:, axis] == sign)[[0, 1, 3, 2]] for axis in range(3) for sign in (-1, 1)]
)
SPANS: Final = np.array([(1, 2), (1, 2), (0, 2), (0, 2), (0, 1), (0, 1)])
# Keeps texture coordinates positive, so that truncation is floor.
SHIFT: Final = 64.0
OCCLUSION_HEIGHT: Final = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """Six faces a cuboid, face 6 * k + f; in-face coordinates are metres from the face's centre.

    A texture coordinate (in tiles) is `scale` times the in-face coordinate plus `shift`. Light is
    `light[0] + light[1] * u + light[2] * v`.
    """

    centres: Floats
    normals: Floats
    axes: Floats
    scales: Floats
    shifts: Floats
    texel_density: Floats
    layers: NDArray[np.int32]
    tints: Floats
    light: Floats


def surfaces_of(cuboids: Cuboids, lighting: Lighting, atlas: Atlas) -> Surfaces:
    """Work out every face of `cuboids`."""
    count = len(cuboids)
    face_axis, face_sign = np.arange(6) // 2, np.where(np.arange(6) % 2, 1, -1).astype(np.float32)
    by_axis = cuboids.rotations.transpose(0, 2, 1)
    normals = by_axis[:, face_axis] * face_sign[:, None]
    centres = cuboids.centres[:, None] + normals * cuboids.half_extents[:, face_axis, None]
    spans = np.broadcast_to(SPANS, (count, 6, 2)).copy()
    halves = np.take_along_axis(np.broadcast_to(cuboids.half_extents[:, None], (count, 6, 3)), spans, axis=2)
    wood = cuboids.materials == Material.WOOD
    swap = wood[:, None] & (halves[..., 1] > halves[..., 0])
    spans[swap], halves[swap] = spans[swap][:, ::-1], halves[swap][:, ::-1]
    axes = np.take_along_axis(by_axis[:, None].repeat(6, axis=1), spans[..., None], axis=2).copy()
    axes[:, :4, 1] *= np.where(wood, 1, -1)[:, None, None]  # texture rows run downwards
    scales, shifts = _mapping(cuboids, halves)
    return Surfaces(
        centres=centres.reshape(-1, 3),
        normals=normals.reshape(-1, 3),
        axes=axes.reshape(-1, 2, 3),
        scales=scales.reshape(-1, 2),
        shifts=shifts.reshape(-1, 2),
        texel_density=(scales.max(axis=2) * SIZE).ravel(),
        layers=_layers(cuboids, atlas).ravel(),
        tints=cuboids.colours.repeat(6, axis=0),
        light=_light(cuboids, lighting, centres=centres, normals=normals, axes=axes, halves=halves).reshape(-1, 3),
    )


def _mapping(cuboids: Cuboids, halves: Floats) -> tuple[Floats, Floats]:
    tile = np.array([TILE_METRES[material] for material in Material], np.float32)[cuboids.materials]
    whole = (tile == 0)[:, None, None]
    tiled = 1 / np.where(tile == 0, 1, tile)[:, None, None]
    scales = np.where(whole, 0.5 / halves, tiled).astype(np.float32)
    hashed = (cuboids.variants[:, None, None] * 37 + np.arange(6)[:, None] * 53 + np.array([0, 29])) % 97 / 97
    return scales, (SHIFT + np.where(whole, 0.5, hashed)).astype(np.float32)


def _layers(cuboids: Cuboids, atlas: Atlas) -> NDArray[np.int32]:
    layers = np.zeros((len(cuboids), 6), np.int32)
    pick = cuboids.variants[:, None] + np.arange(6) // 2 * 7
    for material, choices in atlas.layers.items():
        rows = cuboids.materials == material
        layers[rows] = np.asarray(choices, np.int32)[pick[rows] % len(choices)]
    boxes = cuboids.materials == Material.CARDBOARD
    layers[boxes, 4:] = np.asarray(atlas.box_tops, np.int32)[pick[boxes, 4:] % len(atlas.box_tops)]
    return layers


def _light(
    cuboids: Cuboids, lighting: Lighting, *, centres: Floats, normals: Floats, axes: Floats, halves: Floats
) -> Floats:
    """A plane through the light at the four corners of each face."""
    signs = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)], np.float32)
    reach = signs * halves[:, :, None] * 0.9
    points = centres[:, :, None] + np.einsum("kfcs,kfsx->kfcx", reach, axes)
    light = lighting.on(points, np.broadcast_to(normals[:, :, None], points.shape))
    occluded = np.exp(-np.maximum(points[..., 2], 0) / OCCLUSION_HEIGHT)
    light = light * (1 - 0.4 * occluded * (np.abs(normals[..., 2]) < 0.5)[..., None])
    light[cuboids.materials == Material.CEILING] = 1.0
    mean = light.mean(axis=2)
    slopes = np.einsum("kfc,cs->kfs", light, signs) / 4 / (halves * 0.9)
    return np.concatenate([mean[..., None], slopes], axis=2).astype(np.float32)
