"""Shades visible faces: texture lookup and light for each pixel, a band of rows at a time."""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.simulator.world.camera import Camera, Pose
from services.simulator.world.cuboids import Floats
from services.simulator.world.floor import WHITE, Floor
from services.simulator.world.surfaces import Surfaces
from services.simulator.world.textures import CHAIN, LEVEL_OFFSETS, LEVELS, SIZE, Atlas
from services.simulator.world.visibility import Visibility, to_pixels

BAND_ROWS: Final = 48
SIZE_BITS: Final = SIZE.bit_length() - 1
BACKDROP: Final = 90


class Shader:
    """Colours the pixels of one view; every pixel depends on its own face only, so bands may come in any order."""

    def __init__(
        self,
        *,
        surfaces: Surfaces,
        floor: Floor,
        floor_face: int,
        atlas: Atlas,
        visible: Visibility,
        camera: Camera,
        pose: Pose,
    ) -> None:
        faces = visible.faces
        axes = surfaces.axes[faces] @ pose.rotation
        centres = (surfaces.centres[faces] - pose.position) @ pose.rotation
        offsets = -np.einsum("fsx,fx->fs", axes, centres)
        in_face = to_pixels(axes, camera) + offsets[..., None] * visible.planes[:, None]
        scales, planes = surfaces.scales[faces][..., None], visible.planes[:, None]
        texture = in_face * scales + surfaces.shifts[faces][..., None] * planes
        light = surfaces.light[faces]
        lit = np.einsum("fs,fsp->fp", light[:, 1:], in_face) + light[:, :1] * visible.planes
        self._factors = np.concatenate([texture * SIZE, lit[:, None]], axis=1).transpose(1, 2, 0).copy()
        self._tints = (surfaces.tints[faces].T).copy()
        self._bases = surfaces.layers[faces] * CHAIN
        distance = np.abs(np.einsum("fx,fx->f", surfaces.normals[faces] @ pose.rotation, centres))
        texels = surfaces.texel_density[faces] / camera.fx / np.sqrt(np.maximum(distance, 1e-3))
        self._level_bias = (np.log2(texels) - 0.25).astype(np.float32)
        self._floor, self._floor_slot = floor, _slot_of(faces, floor_face)
        self._floor_scale = float(surfaces.scales[floor_face, 0])
        self._floor_shift = surfaces.shifts[floor_face]
        self._texels = atlas.texels
        self._visible = visible

    def image(self) -> NDArray[np.uint8]:
        """The whole picture, RGB."""
        height, width = self._visible.slots.shape
        image = np.empty((height, width, 3), np.uint8)
        for top in range(0, height, BAND_ROWS):
            image[top : top + BAND_ROWS] = self.band(top, min(top + BAND_ROWS, height))
        return image

    def band(self, top: int, bottom: int) -> NDArray[np.uint8]:
        """The rows from `top` up to `bottom`, RGB."""
        slots = self._visible.slots[top:bottom]
        empty = slots < 0
        if empty.all():
            return np.full((*slots.shape, 3), BACKDROP, np.uint8)
        index = np.maximum(slots, 0).astype(np.intp)
        depth = np.reciprocal(np.where(empty, np.float32(1), self._visible.inverse_depth[top:bottom]))
        rows = np.arange(top, bottom, dtype=np.float32)[:, None]
        columns = np.arange(slots.shape[1], dtype=np.float32)
        u, v, light = (
            (np.take(a, index) * columns + np.take(b, index) * rows + np.take(c, index)) * depth
            for a, b, c in self._factors
        )
        texels = self._lookup(index, u, v, depth)
        colour = self._tinted(index, texels, light)
        self._lay_floor(slots, u, v, texels, colour)
        colour[empty] = BACKDROP
        return colour

    def _lookup(self, index: NDArray[np.intp], u: Floats, v: Floats, depth: Floats) -> NDArray[np.uint8]:
        """RGBA texels at `u`, `v` (texels of the finest level), from the mip level that fits the distance."""
        log_depth = depth.view(np.int32) * np.float32(2.0**-23) - np.float32(127)
        wanted = log_depth * np.float32(1.5) + np.take(self._level_bias, index)
        level = np.clip(wanted, 0, LEVELS - 1).astype(np.int32)
        column, row = u.astype(np.int32) & (SIZE - 1), v.astype(np.int32) & (SIZE - 1)
        texel = np.take(self._bases, index) + np.take(LEVEL_OFFSETS, level)
        texel += ((row >> level) << (SIZE_BITS - level)) + (column >> level)
        found = np.take(self._texels, texel)
        return np.asarray(found.view(np.uint8).reshape(*found.shape, 4))

    def _tinted(self, index: NDArray[np.intp], texels: NDArray[np.uint8], light: Floats) -> NDArray[np.uint8]:
        np.maximum(light, np.float32(0.04), out=light)
        colour = np.empty((*index.shape, 3), np.uint8)
        for channel, tint in enumerate(self._tints):
            value = np.take(tint, index) * light
            value *= texels[..., channel]
            np.minimum(value, 255, out=value)
            colour[..., channel] = value
        return colour

    def _lay_floor(
        self, slots: NDArray[np.int32], u: Floats, v: Floats, texels: NDArray[np.uint8], colour: NDArray[np.uint8]
    ) -> None:
        """Replace the floor's pixels by its own picture, with the texture as detail on top."""
        seen = slots == self._floor_slot
        if not seen.any():
            return
        height, width = self._floor.image.shape[:2]
        to_texels = width / (2 * self._floor.half_x) / self._floor_scale
        x = (u / SIZE - self._floor_shift[0]) * np.float32(to_texels) + np.float32(width / 2)
        y = (v / SIZE - self._floor_shift[1]) * np.float32(to_texels) + np.float32(height / 2)
        base = cv2.remap(self._floor.image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        detail = np.ascontiguousarray(texels[..., :3])
        lit = cv2.multiply(base, detail, scale=1 / WHITE)
        cv2.copyTo(lit, seen.view(np.uint8), colour)


def _slot_of(faces: NDArray[np.intp], face: int) -> int:
    found = np.flatnonzero(faces == face)
    return int(found[0]) if len(found) else -2
