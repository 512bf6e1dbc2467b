"""Rasterises the unoccluded outline of an object at pixel centres, also beyond the image borders."""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from services.simulator.world.camera import Camera, Pose
from services.simulator.world.cuboids import Cuboids, Floats
from services.simulator.world.visibility import facing_rings, planes_of, project

Ints = NDArray[np.int64]
MAX_ROWS: Final = 4096
TIE: Final = 1e-4
MAX_CORNERS: Final = 5  # of a rectangle cut by the near plane


@dataclass(frozen=True, slots=True, eq=False)
class Spans:
    """Runs of pixels of one row each: `faces[i]` covers the columns `starts[i]` to `ends[i]` of `rows[i]`, both in."""

    faces: Ints
    rows: Ints
    starts: Ints
    ends: Ints

    @classmethod
    def of(cls, polygons: NDArray[np.float64], lines: range) -> Self:
        """The rows among `lines` of convex polygons (n, corners, 2) of (column, row)."""
        low, high = polygons[..., 1].min(axis=1), polygons[..., 1].max(axis=1)
        first = np.clip(np.ceil((low - lines.start) / lines.step), 0, len(lines)).astype(np.int64)
        last = np.clip(np.floor((high - lines.start) / lines.step), -1, len(lines) - 1).astype(np.int64)
        counts = np.maximum(last - first + 1, 0)
        faces = np.repeat(np.arange(len(polygons)), counts)
        rows = lines.start + (first[faces] + ramp(counts)) * lines.step
        here = polygons[faces]
        there = np.roll(polygons, -1, axis=1)[faces]
        above, below = here[..., 1] - rows[:, None], there[..., 1] - rows[:, None]
        crossed = (above * below <= 0) & (above != below)
        part = above / np.where(crossed, above - below, 1)
        column = here[..., 0] + part * (there[..., 0] - here[..., 0])
        starts = np.ceil(np.where(crossed, column, np.inf).min(axis=1, initial=np.inf))
        ends = np.floor(np.where(crossed, column, -np.inf).max(axis=1, initial=-np.inf))
        kept = starts <= ends
        return cls(faces[kept], rows[kept], starts[kept].astype(np.int64), ends[kept].astype(np.int64))

    def within(self, camera: Camera) -> Self:
        """The part inside the image."""
        starts, ends = np.maximum(self.starts, 0), np.minimum(self.ends, camera.width - 1)
        kept = (starts <= ends) & (self.rows >= 0) & (self.rows < camera.height)
        return type(self)(self.faces[kept], self.rows[kept], starts[kept], ends[kept])

    def area(self) -> int:
        """How many pixels they cover, each counted once."""
        if not len(self.rows):
            return 0
        line = self.rows * (int(self.ends.max()) - int(self.starts.min()) + 2)
        order = np.argsort(line + self.starts, kind="stable")
        starts, ends = (line + self.starts)[order], (line + self.ends)[order]
        reached = np.concatenate([starts[:1] - 1, np.maximum.accumulate(ends)[:-1]])
        return int(np.maximum(ends - np.maximum(starts - 1, reached), 0).sum())

    def pixels(self) -> tuple[Ints, Ints, Ints]:
        """The face, row and column of every covered pixel, once for each face that covers it."""
        lengths = self.ends - self.starts + 1
        spans = np.repeat(np.arange(len(lengths)), lengths)
        return self.faces[spans], self.rows[spans], self.starts[spans] + ramp(lengths)


@dataclass(frozen=True, slots=True, eq=False)
class Silhouette:
    """The pixels that an unoccluded object covers: the number `outside` the image, and those inside, face by face.

    A pixel is inside once for each face of the object that covers it, with that face's inverse depth in 1/m.
    """

    outside: int
    rows: Ints
    columns: Ints
    inverse_depth: NDArray[np.float64]

    @classmethod
    def of(cls, parts: Cuboids, pose: Pose, camera: Camera) -> Self:
        """Draw an object's own faces. Of one higher than `MAX_ROWS` the pixels outside are an estimate."""
        _, rings = facing_rings(parts, pose)
        polygons = _padded(project(rings, camera))
        inside = Spans.of(polygons, range(camera.height)).within(camera)
        faces, rows, columns = inside.pixels()
        a, b, c = planes_of(rings, camera).astype(np.float64)[faces].T
        return cls(_outside(polygons, camera), rows, columns, a * columns + b * rows + c)

    def visibility(self, own: NDArray[np.bool_], depth: Floats) -> float:
        """The visible share of an object: `own`, the mask (height, width) of its visible pixels, of all its pixels.

        depth: metres of what is seen in each pixel, 0 where nothing is. A pixel counts as hidden only if something
        nearer is seen there: pixels that rounding gives to the surface behind an edge hide nothing.
        """
        visible = int(np.count_nonzero(own))
        hidden = self.outside + self._covered(~own[self.rows, self.columns], depth)
        return visible / (visible + hidden) if hidden else 1.0

    def _covered(self, lost: NDArray[np.bool_], depth: Floats) -> int:
        rows, columns = self.rows[lost], self.columns[lost]
        nearest = np.zeros(depth.shape)
        np.maximum.at(nearest, (rows, columns), self.inverse_depth[lost])
        return int(np.sum((nearest > 0) & (depth > 0) & (depth * nearest < 1 - TIE)))


def _outside(polygons: NDArray[np.float64], camera: Camera) -> int:
    """The number of pixels that polygons cover beyond the borders of the image."""
    if not len(polygons):
        return 0
    low, high = int(np.floor(polygons[..., 1].min())), int(np.ceil(polygons[..., 1].max()))
    step = 1 + (high - low) // MAX_ROWS
    spans = Spans.of(polygons, range(low, high + 1, step))
    return (spans.area() - spans.within(camera).area()) * step


def ramp(counts: Ints) -> Ints:
    """0, 1, 2, ... for each count, one after the other."""
    return np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)


def _padded(polygons: list[Floats]) -> NDArray[np.float64]:
    padded = [np.concatenate([p, np.repeat(p[-1:], MAX_CORNERS - len(p), axis=0)]) for p in polygons]
    return np.asarray(padded, np.float64).reshape(-1, MAX_CORNERS, 2)
