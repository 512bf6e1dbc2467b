"""The texture atlas: small procedural tiles with mip levels, made once and shared by every scene."""

from dataclasses import dataclass
from functools import cache
from typing import Final

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from services.simulator.world.cuboids import Floats, Material

SIZE: Final = 256
LEVELS: Final = 8
LEVEL_OFFSETS: Final = np.cumsum([0] + [(SIZE >> level) ** 2 for level in range(LEVELS)]).astype(np.int32)
CHAIN: Final = int(LEVEL_OFFSETS[-1])
WHOLE_FACE: Final = 0.0

# Metres that one tile covers; WHOLE_FACE stretches one tile over each face.
TILE_METRES: Final = {
    Material.PLAIN: 0.8,
    Material.METAL: 1.2,
    Material.CARDBOARD: WHOLE_FACE,
    Material.WOOD: 1.3,
    Material.HAZARD: 0.4,
    Material.FLOOR: 2.0,
    Material.WALL: 2.6,
    Material.CEILING: 4.0,
}


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """`texels` holds RGBA pixels as uint32, one mip chain of `CHAIN` texels per layer."""

    texels: NDArray[np.uint32]
    layers: dict[Material, tuple[int, ...]]
    box_tops: tuple[int, ...]


@cache
def atlas() -> Atlas:
    """The one atlas; the same in every process."""
    rng = np.random.default_rng(20240229)
    tiles: list[NDArray[np.uint8]] = []

    def register(*images: Floats) -> tuple[int, ...]:
        tiles.extend(np.clip(image * 255 + 0.5, 0, 255).astype(np.uint8) for image in images)
        return tuple(range(len(tiles) - len(images), len(tiles)))

    layers = {
        Material.PLAIN: register(*(_grey(0.93 + 0.02 * _noise(rng, 64, 16)) for _ in range(2))),
        Material.METAL: register(*(_metal(rng) for _ in range(3))),
        Material.CARDBOARD: register(*(_box_side(rng) for _ in range(16))),
        Material.WOOD: register(*(_wood(rng) for _ in range(5))),
        Material.HAZARD: register(_hazard(rng)),
        Material.FLOOR: register(*(_concrete(rng) for _ in range(2))),
        Material.WALL: register(*(_wall(rng, kind) for kind in range(4))),
        Material.CEILING: register(*(_ceiling(kind) for kind in range(2))),
    }
    box_tops = register(*(_box_top(rng) for _ in range(8)))
    return Atlas(np.concatenate([_mip_chain(tile) for tile in tiles]), layers, box_tops)


def _mip_chain(tile: NDArray[np.uint8]) -> NDArray[np.uint32]:
    levels = []
    image = np.dstack([tile, np.full((SIZE, SIZE), 255, np.uint8)])
    for level in range(LEVELS):
        levels.append(np.ascontiguousarray(image).view(np.uint32).ravel())
        half = SIZE >> (level + 1)
        image = cv2.resize(image, (half, half), interpolation=cv2.INTER_AREA)
    return np.concatenate(levels)


def _noise(rng: Generator, *cells: int) -> Floats:
    """Seamless noise of about unit variance with octaves of `cells` cells a side."""
    total = np.zeros((SIZE, SIZE), np.float32)
    for count in cells:
        coarse = np.pad(rng.normal(0, 1, (count, count)).astype(np.float32), 2, mode="wrap")
        step = SIZE // count
        wide = cv2.resize(coarse, None, fx=step, fy=step, interpolation=cv2.INTER_CUBIC)
        total += wide[2 * step : 2 * step + SIZE, 2 * step : 2 * step + SIZE]
    return np.asarray(total / np.sqrt(len(cells)), np.float32)


def _grey(value: Floats) -> Floats:
    return np.repeat(value[..., None], 3, axis=2)


def _metal(rng: Generator) -> Floats:
    value = 0.93 + 0.02 * _noise(rng, 128, 32, 8)
    for _ in range(12):
        x, y, dx, dy = (int(n) for n in rng.integers(0, SIZE, 4))
        cv2.line(value, (x, y), (x + dx // 6 - 20, y + dy // 6 - 20), float(rng.choice([0.8, 1.0])), 1, cv2.LINE_AA)
    return _grey(value)


def _cardboard(rng: Generator) -> Floats:
    grain = 1 + 0.035 * _noise(rng, 128, 64) + 0.03 * _noise(rng, 16, 4)
    edge = np.minimum(np.arange(SIZE), np.arange(SIZE)[::-1]).astype(np.float32)
    distance = np.minimum(edge[:, None], edge[None])
    wear = 1 - 0.16 * np.exp(-distance / 14) - 0.25 * (distance < 2)
    brown = np.array([0.62, 0.46, 0.29], np.float32) * rng.normal(1, 0.04)
    return np.asarray((grain * wear)[..., None] * brown, np.float32)


def _tape(image: Floats, rng: Generator, rows: slice, columns: slice) -> None:
    tint = np.array([(0.75, 0.62, 0.42), (0.55, 0.42, 0.26), (0.82, 0.8, 0.75)][int(rng.integers(3))], np.float32)
    image[rows, columns] = image[rows, columns] * 0.45 + tint * 0.5


def _box_top(rng: Generator) -> Floats:
    image = _cardboard(rng)
    if rng.random() < 0.85:
        half = int(rng.integers(9, 18))
        _tape(image, rng, slice(128 - half, 128 + half), slice(0, SIZE))
    image[126:129] *= 0.62
    if rng.random() < 0.4:
        _label(image, rng)
    return image


def _box_side(rng: Generator) -> Floats:
    image = _cardboard(rng)
    draw = rng.random()
    if draw < 0.4:
        half = int(rng.integers(9, 16))
        _tape(image, rng, slice(0, int(rng.integers(40, 90))), slice(128 - half, 128 + half))
    if 0.25 < draw < 0.75:
        _label(image, rng)
    if draw > 0.6:
        _print(image, rng)
    if draw > 0.9:
        image[60:196] = image[60:196] * 0.5 + np.array(rng.uniform(0.1, 0.5, 3), np.float32)
    return image


def _label(image: Floats, rng: Generator) -> None:
    width, height = int(rng.integers(50, 110)), int(rng.integers(40, 90))
    x, y = int(rng.integers(12, SIZE - width - 12)), int(rng.integers(12, SIZE - height - 12))
    image[y : y + height, x : x + width] = 0.88
    for row in range(y + 8, y + height // 2, 9):
        image[row : row + 3, x + 6 : x + 6 + int(rng.integers(20, width - 10))] = 0.25
    bars = np.repeat(rng.random(width) < 0.5, 2)[: width - 12]
    image[y + height // 2 + 4 : y + height - 6, x + 6 : x + width - 6][:, bars] = 0.15


def _print(image: Floats, rng: Generator) -> None:
    ink = np.array([(0.2, 0.15, 0.1), (0.6, 0.15, 0.1), (0.1, 0.2, 0.45)][int(rng.integers(3))], np.float32)
    colour = tuple(float(c) for c in ink)
    x, y = int(rng.integers(30, 120)), int(rng.integers(120, 220))
    if rng.random() < 0.5:
        for arrow in (x, x + 34):
            cv2.arrowedLine(image, (arrow, y + 25), (arrow, y - 20), colour, 5, cv2.LINE_AA, 0, 0.4)
    else:
        for row in range(2):
            cv2.line(image, (x, y + 18 * row), (x + int(rng.integers(40, 110)), y + 18 * row), colour, 9)


def _wood(rng: Generator) -> Floats:
    """Grain along the tile's u axis."""
    streaks = cv2.GaussianBlur(np.tile(rng.normal(0, 1, (SIZE, 1)), (1, SIZE)).astype(np.float32), (1, 5), 0)
    value = 1 + 0.09 * streaks + 0.05 * _noise(rng, 16, 8) + 0.03 * _noise(rng, 128)
    for _ in range(int(rng.integers(1, 4))):
        knot = (int(rng.integers(SIZE)), int(rng.integers(SIZE)))
        cv2.ellipse(value, knot, (9, 4), 0, 0, 360, 0.6, -1, cv2.LINE_AA)
    return np.asarray(value[..., None] * (0.7, 0.56, 0.38), np.float32)


def _hazard(rng: Generator) -> Floats:
    x, y = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    dark = (((x + y) // 64) % 2 == 1)[..., None]
    image = np.where(dark, np.float32(0.08), np.array([0.92, 0.74, 0.08], np.float32))
    return np.asarray(image * (1 + 0.04 * _noise(rng, 64, 8))[..., None], np.float32)


def _concrete(rng: Generator) -> Floats:
    return _grey(0.9 + 0.03 * _noise(rng, 128, 64) + 0.03 * _noise(rng, 16, 8, 4))


def _wall(rng: Generator, kind: int) -> Floats:
    value = 0.92 + 0.02 * _noise(rng, 64, 8, 4)
    columns = np.arange(SIZE)
    if kind == 1:  # corrugated sheet
        value *= 1 + 0.06 * np.sign(np.sin(columns * 2 * np.pi / 32)).astype(np.float32)
    if kind == 2:  # blocks
        rows = columns[:, None] % 32
        shifted = (columns[None] + 32 * ((columns[:, None] // 32) % 2)) % 64
        value = np.where((rows < 2) | (shifted < 2), value * 0.85, value)
    if kind == 3:  # panels
        value = np.where(columns[None] % 128 < 3, value * 0.7, value)
    return _grey(value.astype(np.float32))


def _ceiling(kind: int) -> Floats:
    value = np.full((SIZE, SIZE), 0.45, np.float32)
    value[:, ::64] = 0.3
    if kind:
        value[96:104, 16:112] = 1.0
        value[224:232, 16:112] = 1.0
    else:
        cv2.circle(value, (64, 64), 14, 1.0, -1, cv2.LINE_AA)
    return _grey(value)
